"""Collect: record the new episodes of an iteration."""

from __future__ import annotations

from collections.abc import Sequence

from flywheel.errors import RunError
from flywheel.results import Arm
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.pool.jobs import PoolReport
from flywheel.runtime.run.context import Run, episode_notes
from flywheel.runtime.stages.outcomes import Collected, Tally
from flywheel.runtime.workers.episode_note import EpisodeNote
from flywheel.runtime.workers.episode_plan import EpisodePlan, collection, first_recordings


def collect(run: Run, iteration: int, arms: list[Arm], tally: Tally) -> list[Collected]:
    """Record the new episodes of every arm: gaits, random controls and drops, or MPPI.

    Raises:
      RunError: too few episodes of an arm are valid.
    """
    effects, anew = run.effects(iteration), run.changes_plant(iteration)
    plans = {arm: collection(run.config, iteration, arm, effects, anew) for arm in arms}
    jobs = [job for arm in arms for job in run.episode_jobs(plans[arm], run.latest_model(arm))]
    jobs = list({job.id: job for job in jobs}.values())  # episodes of a new plant serve all arms
    on_robot = first_recordings(run.config) if run.config.robot and iteration == 0 else []
    jobs += run.robot_jobs(on_robot)
    report = tally.add(run.do(jobs, f"{iteration}: collect"))
    collected = []
    for arm in arms:
        done, valid = episode_notes(report, plans[arm]), valid_notes(report, plans[arm], tally)
        _check_enough(
            run.config, len(plans[arm]), len(valid), f"iteration {iteration} ({arm})", tally
        )
        collected.append(
            Collected(
                arm,
                segments=tuple(note.id for note in valid),
                steps=sum(note.steps for note in valid),
                invalid=len(done) - len(valid),
                quarantined=len(plans[arm]) - len(done),
            )
        )
    _check_enough(
        run.config, len(on_robot), len(valid_notes(report, on_robot, tally)), "the robot", tally
    )
    return collected


def valid_notes(
    report: PoolReport, plans: Sequence[EpisodePlan], tally: Tally
) -> list[EpisodeNote]:
    """The reports about stored episodes; the others become sentences in the tally."""
    done = episode_notes(report, plans)
    tally.problems += [f"{n.id} was discarded: {n.invalid}" for n in done if n.invalid]
    return [note for note in done if not note.invalid]


def _check_enough(config: RunConfig, wanted: int, valid: int, what: str, tally: Tally) -> None:
    if valid < config.workers.least_episodes * wanted:
        raise RunError(
            f"Only {valid} of {wanted} episodes of {what} could be recorded; at least "
            f"{config.workers.least_episodes:.0%} are required (workers.least_episodes). "
            f"{tally.problems[-1]}"
        )
