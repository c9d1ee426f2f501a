"""Scoring models on the store's episodes with many workers, in shares that add up exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import Any

from flywheel.data import EpisodeSummary
from flywheel.records import Split
from flywheel.results import ErrorNumbers, Errors, Navigation
from flywheel.runtime.pool.jobs import Job, PoolReport
from flywheel.runtime.run.context import Model, Run, episode_notes
from flywheel.runtime.workers.episode_plan import Effects, EpisodePlan, derive_seed
from flywheel.runtime.workers.sim_worker import Baseline, KnownPlant, Scores, added

EPISODES_PER_JOB = 8  # fixed, so that the size of a batch does not depend on the number of workers
PLANS_KEPT = 2000
_NOT_FINITE = Errors(short=ErrorNumbers(e_pos_mse=math.nan, e_pos_rmse=math.nan, e_rot=math.nan))


def score_jobs(
    run: Run,
    name: str,
    dynamics: Model | Baseline | KnownPlant,
    episodes: Sequence[str],
    effects: Effects,
    full: bool | None = None,
) -> list[Job]:
    """Jobs that score one dynamics model.

    Args:
      run: in progress.
      name: of the scored model, for the jobs' ids.
      dynamics: a trained model of the run, a baseline, or the plant.
      episodes: ids.
      effects: adopted so far, for the reckoning of unmeasured winches.
      full: also predict whole episodes; by default as configured (`evaluate.full`).
    """
    full = run.config.evaluate.full if full is None else full
    seed = derive_seed(run.config.seed, "score")
    subject: Any = dynamics
    if not isinstance(dynamics, Baseline | KnownPlant):
        subject = run.shared_weights(dynamics)
    shares = [
        tuple(episodes[i : i + EPISODES_PER_JOB]) for i in range(0, len(episodes), EPISODES_PER_JOB)
    ]
    return [
        Job(
            f"score-{name}-{i:03d}",
            "sim",
            "score",
            (subject, share, seed, full, effects),
            size=len(share),
        )
        for i, share in enumerate(shares)
    ]


def scored(report: PoolReport, jobs: Sequence[Job]) -> Errors | None:
    """The errors from the jobs of `score_jobs`; NaN if a rollout was not finite, None without episodes."""
    shares: list[Scores] = [report.results[job.id] for job in jobs if job.id in report.results]
    if not shares:
        return None
    total = reduce(added, shares)
    if total.short is None:
        return _NOT_FINITE
    return Errors.of(total.short, total.full, total.by_episode)


def navigation(
    run: Run, controller: str, report: PoolReport, plans: Sequence[EpisodePlan]
) -> Navigation | None:
    """The results of closed-loop episodes; None without one.

    Args:
      run: in progress.
      controller: its name, e.g. "mppi on the plant".
      report: of the pool that recorded the episodes.
      plans: of the episodes.
    """
    done = episode_notes(report, plans)
    walks = tuple(note.walk for note in done if note.walk is not None)
    if not walks:
        return None
    seconds = [s for note in done for s in note.plan_seconds]
    task = run.config.task
    return Navigation(
        controller=controller,
        walks=walks,
        seconds_allowed=task.seconds,
        tolerance=task.tolerance * run.robot.length,
        plan_seconds=tuple(seconds[:: 1 + len(seconds) // PLANS_KEPT]),
    )


def by_split(summaries: Sequence[EpisodeSummary]) -> dict[Split, list[str]]:
    """The ids of the episodes of each split, in order."""
    found: dict[Split, list[str]] = {"train": [], "validation": [], "test": []}
    for summary in summaries:
        found[summary.split].append(summary.id)
    return found
