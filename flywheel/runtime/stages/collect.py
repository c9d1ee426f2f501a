"""Collect: record the new episodes of an iteration."""

from __future__ import annotations

from collections.abc import Sequence

from flywheel.errors import RunError
from flywheel.results import Arm
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.pool.jobs import PoolReport
from flywheel.runtime.run.context import Run, episode_notes
from flywheel.runtime.stages.outcomes import Collected, Iteration
from flywheel.runtime.workers.episode_note import EpisodeNote
from flywheel.runtime.workers.episode_plan import EpisodePlan, collection, first_recordings


def collect(run: Run, iteration: Iteration, arms: list[Arm]) -> list[Collected]:
    """Record the new episodes of every arm: gaits, random controls and drops, or MPPI.

    Raises:
      RunError: too few episodes of an arm are valid.
    """
    number, effects, anew = iteration.number, iteration.effects, iteration.anew
    plans = {arm: collection(run.config, number, arm, effects, anew) for arm in arms}
    models = iteration.models
    jobs = [job for arm in arms for job in run.episode_jobs(plans[arm], models.get(arm))]
    jobs = list({job.id: job for job in jobs}.values())  # episodes of a new plant serve all arms
    on_robot = first_recordings(run.config) if run.config.robot and number == 0 else []
    jobs += run.robot_jobs(on_robot)
    report = iteration.add(run.do(jobs, f"{number}: collect"))
    collected = []
    for arm in arms:
        done, valid = episode_notes(report, plans[arm]), valid_notes(report, plans[arm], iteration)
        _check_enough(
            run.config, len(plans[arm]), len(valid), f"iteration {number} ({arm})", iteration
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
    measured = valid_notes(report, on_robot, iteration)
    _check_enough(run.config, len(on_robot), len(measured), "the robot", iteration)
    return collected


def valid_notes(
    report: PoolReport, plans: Sequence[EpisodePlan], iteration: Iteration
) -> list[EpisodeNote]:
    """The reports about stored episodes; the others become problems of the iteration."""
    done = episode_notes(report, plans)
    iteration.problems += [f"{n.id} was discarded: {n.invalid}" for n in done if n.invalid]
    return [note for note in done if not note.invalid]


def _check_enough(
    config: RunConfig, wanted: int, valid: int, what: str, iteration: Iteration
) -> None:
    if valid < config.workers.least_episodes * wanted:
        raise RunError(
            f"Only {valid} of {wanted} episodes of {what} could be recorded; at least "
            f"{config.workers.least_episodes:.0%} are required (workers.least_episodes). "
            f"{iteration.problems[-1]}"
        )
