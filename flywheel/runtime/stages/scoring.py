"""Scoring models on the store's episodes with many workers, in shares that add up exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import Any

from flywheel.data import EpisodeSummary
from flywheel.records import Split
from flywheel.runtime.pool.jobs import Job, PoolReport
from flywheel.runtime.results import ErrorNumbers, Errors, Navigation
from flywheel.runtime.run.context import Run, notes
from flywheel.runtime.workers.episode_plan import Effects, EpisodePlan, derive_seed
from flywheel.runtime.workers.sim_worker import Scores, added

EPISODES_PER_JOB = 8  # fixed, so that the size of a batch does not depend on the number of workers
PLANS_KEPT = 2000


def score_jobs(
    run: Run,
    name: str,
    subject: Any,
    episodes: Sequence[str],
    effects: Effects,
    full: bool | None = None,
) -> list[Job]:
    """Jobs that score one subject.

    Args:
      run: under way.
      name: of the subject, for the jobs' ids.
      subject: shared weights, or the name of a baseline.
      episodes: ids.
      effects: adopted so far.
      full: also predict whole episodes; as configured by default.
    """
    full = run.config.evaluate.full if full is None else full
    seed = derive_seed(run.config.seed, "score")
    parts = [
        tuple(episodes[i : i + EPISODES_PER_JOB]) for i in range(0, len(episodes), EPISODES_PER_JOB)
    ]
    return [
        Job(
            f"score-{name}-{i:03d}",
            "sim",
            "score",
            (subject, part, seed, full, effects),
            size=len(part),
        )
        for i, part in enumerate(parts)
    ]


def scored(report: PoolReport, jobs: Sequence[Job]) -> Errors | None:
    """What `score_jobs` found; NaN if a rollout was not finite, None without episodes."""
    parts: list[Scores] = [report.results[job.id] for job in jobs if job.id in report.results]
    if not parts:
        return None
    total = reduce(added, parts)
    if total.short is None:
        return _NOT_FINITE
    return Errors.of(total.short, total.full, total.by_episode)


_NOT_FINITE = Errors(short=ErrorNumbers(e_pos_mse=math.nan, e_pos_rmse=math.nan, e_rot=math.nan))


def navigation(
    run: Run, controller: str, report: PoolReport, plans: Sequence[EpisodePlan]
) -> Navigation | None:
    """What came of closed-loop episodes; None without one."""
    done = notes(report, plans)
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
    """Episode ids of each split, in order."""
    found: dict[Split, list[str]] = {"train": [], "validation": [], "test": []}
    for summary in summaries:
        found[summary.split].append(summary.id)
    return found
