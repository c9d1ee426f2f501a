"""Summary of several runs of one configuration with different seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.errors import DataError
from flywheel.results import Errors, Navigation, RunResult, Success
from flywheel.validation import differences

SEED_ONLY = ("seed", "name", "workers", "tracking", "store")


@dataclass(frozen=True)
class Spread:
    """A number over the runs: mean, lowest and highest."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        ends = f" ({self.low:.3g}-{self.high:.3g})" if self.low < self.high else ""
        return f"{self.mean:.3g}{ends}"


@dataclass(frozen=True)
class SeedRow:
    """One line of the summary.

    Attributes:
      name: of the model, or of the line for comparison.
      e_pos_mse, e_pos_rmse, e_rot: short-horizon errors on each run's own pooled tests [%], [deg].
      full_rmse, full_rot: over whole episodes.
      success: of all runs' tasks together.
      seconds: median time to the goal, over all reached goals [s].
    """

    name: str
    e_pos_mse: Spread | None = None
    e_pos_rmse: Spread | None = None
    e_rot: Spread | None = None
    full_rmse: Spread | None = None
    full_rot: Spread | None = None
    success: Success | None = None
    seconds: float | None = None


def summarise(runs: Sequence[RunResult]) -> list[SeedRow]:
    """One row per model and per line for comparison, over all runs.

    Raises:
      DataError: no run, one that is not finished, two with the same seed, or with configurations that
        differ in more than the seed.
    """
    _check(runs)
    models = [(i.iteration, i.arm) for i in runs[0].iterations]
    rows = []
    for key in models:
        results = [next(i for i in run.iterations if (i.iteration, i.arm) == key) for run in runs]
        errors = [run.test_errors(result) for run, result in zip(runs, results, strict=True)]
        name = f"iteration {key[0]}" + ("" if key[1] == "mppi" else ", control arm")
        rows.append(_row(name, errors, [result.navigation for result in results]))
    none: list[Navigation | None] = [None] * len(runs)
    rows.append(_row("floor", [run.floor for run in runs], none))
    rows.append(_row("informed floor", [run.informed_floor for run in runs], none))
    rows.append(_row("nothing moves", [run.persistence for run in runs], none))
    unmeasured: list[Errors | None] = [None] * len(runs)
    rows.append(_row("oracle", unmeasured, [run.oracle for run in runs]))
    for courses in zip(*(run.unseen for run in runs), strict=True):
        name = courses[0].course
        rows.append(_row(f"{name}, never seen", unmeasured, [u.navigation for u in courses]))
        rows.append(_row(f"{name}, oracle", unmeasured, [u.oracle for u in courses]))
    return rows


def _check(runs: Sequence[RunResult]) -> None:
    if not runs:
        raise DataError("There is no run to summarise.")
    for run in runs:
        if not run.finished:
            raise DataError(f"The run {run.name!r} has not ended; complete it first (--resume).")
    seeds = [run.config.get("seed") for run in runs]
    if len(set(seeds)) < len(seeds):
        raise DataError(f"Each run needs a different seed, got {', '.join(map(str, seeds))}.")
    first = _without_seed(runs[0])
    for run in runs[1:]:
        if changes := list(differences(first, _without_seed(run))):
            raise DataError(
                f"Runs {runs[0].name!r} (seed {seeds[0]}) and {run.name!r} (seed "
                f"{run.config.get('seed')}) differ in more than the seed:\n  "
                + "\n  ".join(changes)
            )


def _without_seed(run: RunResult) -> dict[str, object]:
    return {key: value for key, value in run.config.items() if key not in SEED_ONLY}


def _row(
    name: str, errors: Sequence[Errors | None], navigation: Sequence[Navigation | None]
) -> SeedRow:
    walked = [n for n in navigation if n is not None]
    seconds = [s for n in walked for s in n.seconds_to_goal]
    return SeedRow(
        name=name,
        e_pos_mse=_spread(errors, lambda e: e.short.e_pos_mse),
        e_pos_rmse=_spread(errors, lambda e: e.short.e_pos_rmse),
        e_rot=_spread(errors, lambda e: e.short.e_rot),
        full_rmse=_spread(errors, lambda e: None if e.full is None else e.full.e_pos_rmse),
        full_rot=_spread(errors, lambda e: None if e.full is None else e.full.e_rot),
        success=sum((n.success for n in walked), Success()) if walked else None,
        seconds=float(np.median(seconds)) if seconds else None,
    )


def _spread(
    errors: Sequence[Errors | None], number: Callable[[Errors], float | None]
) -> Spread | None:
    """None if a run has no such number: a mean over some of the runs would mislead."""
    found = [None if e is None else number(e) for e in errors]
    values = [value for value in found if value is not None]
    if len(values) < len(found):
        return None
    return Spread(float(np.mean(values)), min(values), max(values))
