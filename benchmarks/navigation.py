"""Results of closed-loop driving as tables: models of runs, and episodes one by one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isnan

import numpy as np

from flywheel.cli.driving.drives import DriveLine, where_of
from flywheel.evaluation.intervals import success_interval
from flywheel.results import Errors, Navigation, RunResult
from flywheel.runtime.run.folder import name_of

RUN_HEADER = (
    "| model | trained on [s] | e_pos RMSE/L [%] | e_rot [deg] | reached | all (95 %) | median [s] |\n"
    "|---|---|---|---|---|---|---|"
)
EPISODES_HEADER = (
    "| run | model | where | hidden | reached (95 %) | median [s] | slowest [s] |\n"
    "|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True)
class ModelRow:
    """A model of a run, or a baseline, on the pooled test episodes of all iterations.

    Attributes:
      run, seed: name of the run, and its seed.
      model: name of the iteration ("i0002-mppi"), or "persistence", "floor", "informed floor".
      trained_seconds: of the episodes that it was trained on [s].
      e_pos_rmse, e_rot: over the short horizon [% of the robot's length], [deg]; not a number where a
        prediction was not finite.
    """

    run: str
    seed: int
    model: str
    trained_seconds: float
    e_pos_rmse: float
    e_rot: float


@dataclass(frozen=True)
class EpisodeRow:
    """One closed-loop episode.

    Attributes:
      run, seed: name of the run of the model, and its seed.
      model: name of the iteration, "champion", "oracle" (MPPI that knows the plant), or "astar".
      digest: the first digits of that of its weights, or "".
      where: the course, or the task, and uneven ground.
      told: known effects of the plant, beyond its MJCF.
      hidden: true effects of the plant, if they differ.
      task_seed: of the task.
      reached: the goal, in time.
      seconds: to the goal, or to the end of the episode [s].
      distance: to the goal at the end [m].
      samples, horizon_seconds, threads: of the planner; 0 if unknown.
      plan_seconds, plan_seconds_95: median and 95 % quantile of a plan's time [s].
      cpu_seconds: of the episode, in all threads [s].
    """

    run: str
    seed: int
    model: str
    digest: str
    where: str
    told: str
    hidden: str
    task_seed: int
    reached: bool
    seconds: float
    distance: float
    samples: int = 0
    horizon_seconds: float = math.nan
    threads: int = 0
    plan_seconds: float = math.nan
    plan_seconds_95: float = math.nan
    cpu_seconds: float = math.nan


def models_of(run: str, result: RunResult) -> Iterator[ModelRow]:
    """The rows of a run: its models, and the baselines."""
    seed, dt = result.config["seed"], result.config["network"]["dt"]
    for each in result.iterations:
        errors = result.test_errors(each)
        name = name_of(each.iteration, each.arm)
        yield ModelRow(run, seed, name, each.steps * dt, *_short(errors))
    beside = {
        "persistence": result.persistence,
        "floor": result.floor,
        "informed floor": result.informed_floor,
    }
    for name, errors in beside.items():
        if errors is not None:
            yield ModelRow(run, seed, name, math.nan, *_short(errors))


def episodes_of(run: str, result: RunResult) -> Iterator[EpisodeRow]:
    """The closed-loop episodes of a run: of every model, and of MPPI that knows the plant."""
    task = result.config["task"]
    where = task["course"] if task["name"] == "obstacle_course" else task["name"]
    driven = [
        (name_of(each.iteration, each.arm), where, each.navigation) for each in result.iterations
    ]
    driven.append(("oracle", where, result.oracle))
    for unseen in result.unseen:
        driven.append(("champion", unseen.course, unseen.navigation))
        driven.append(("oracle", unseen.course, unseen.oracle))
    for model, place, navigation in driven:
        if navigation is not None:
            yield from _walked(run, result.config["seed"], model, place, navigation)


def driven_episodes(run: str, seed: int, drives: Sequence[DriveLine]) -> Iterator[EpisodeRow]:
    """The rows of episodes from `flywheel navigate --results`."""
    for drive in drives:
        setting = drive.setting
        yield EpisodeRow(
            run=run,
            seed=seed,
            model=setting.model if setting.controller == "mppi" else setting.controller,
            digest=setting.digest[:8],
            where=where_of(setting),
            told=", ".join(setting.effects),
            hidden=", ".join(setting.hidden),
            task_seed=drive.seed,
            reached=drive.walk.reached,
            seconds=drive.walk.seconds,
            distance=drive.walk.distance,
            samples=setting.samples,
            horizon_seconds=setting.horizon_seconds,
            threads=setting.threads,
            plan_seconds=drive.plan_seconds[0],
            plan_seconds_95=drive.plan_seconds[1],
            cpu_seconds=drive.cpu_seconds,
        )


def run_table(
    run: str, models: Sequence[ModelRow], episodes: Sequence[EpisodeRow], where: str
) -> list[str]:
    """Lines of Markdown about one run: a row per model, the values of its seeds with " / " between."""
    models = [row for row in models if row.run == run]
    driven = [row for row in episodes if (row.run, row.where) == (run, where)]
    lines = [RUN_HEADER]
    for name in dict.fromkeys([*(row.model for row in models), *(row.model for row in driven)]):
        cells = (
            name,
            *_errors([row for row in models if row.model == name]),
            *_drives([row for row in driven if row.model == name]),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _errors(rows: Sequence[ModelRow]) -> tuple[str, str, str]:
    """Cells about predictions: one value per seed."""
    trained = "" if all(isnan(row.trained_seconds) for row in rows) else ".0f"
    return (
        " / ".join(format(row.trained_seconds, trained) for row in rows) if trained else "",
        " / ".join(_number(row.e_pos_rmse, "diverged") for row in rows),
        " / ".join(_number(row.e_rot, "diverged") for row in rows),
    )


def _drives(rows: Sequence[EpisodeRow]) -> tuple[str, str, str]:
    """Cells about driving: reached and the median of each seed, and all seeds together."""
    if not rows:
        return "", "", ""
    seeds = [
        [row for row in rows if row.seed == seed] for seed in dict.fromkeys(r.seed for r in rows)
    ]
    times = [[row.seconds for row in group if row.reached] for group in seeds]
    return (
        " / ".join(f"{len(t)} of {len(group)}" for t, group in zip(times, seeds, strict=True)),
        _share(sum(map(len, times)), len(rows)),
        " / ".join(_number(float(np.median(t)) if t else math.nan, "-") for t in times),
    )


def _share(reached: int, total: int) -> str:
    share = success_interval(reached, total, method="exact")
    return f"{reached} of {total} ({100 * share.low:.0f}-{100 * share.high:.0f})"


def _number(value: float, missing: str) -> str:
    return missing if isnan(value) else f"{value:.1f}"


def episodes_table(rows: Sequence[EpisodeRow]) -> list[str]:
    """Lines of Markdown: a row per model and place, all seeds together, with exact intervals."""
    lines = [EPISODES_HEADER]
    for key in dict.fromkeys(_setting(row) for row in rows):
        group = [row for row in rows if _setting(row) == key]
        times = sorted(row.seconds for row in group if row.reached)
        median, slowest = (f"{np.median(times):.1f}", f"{times[-1]:.1f}") if times else ("", "")
        run, model, where, hidden, told = key
        what = f"{model}, told {told}" if told else model
        lines.append(
            f"| {run} | {what} | {where} | {hidden} | {_share(len(times), len(group))} | "
            f"{median} | {slowest} |"
        )
    return lines


def courses_table(rows: Sequence[EpisodeRow], runs: Mapping[str, str]) -> list[str]:
    """Lines of Markdown: a row per course, with each run's goals reached (by training seed) and median time.

    Args:
      rows: episodes of these runs, and of others.
      runs: name of a run -> head of its column.
    """
    lines = [f"| course | {' | '.join(runs.values())} |", f"|---{'|---' * len(runs)}|"]
    of_runs = [row for row in rows if row.run in runs]
    for where in [*dict.fromkeys(row.where for row in of_runs), ""]:  # the last one is for all
        here = [row for row in of_runs if where in ("", row.where)]
        cells = [_reached([row for row in here if row.run == run]) for run in runs]
        lines.append(f"| {f'`{where}`' if where else 'all'} | {' | '.join(cells)} |")
    return lines


def _reached(rows: Sequence[EpisodeRow]) -> str:
    times = [row.seconds for row in rows if row.reached]
    median = f", {np.median(times):.0f} s" if times else ""
    return f"{_share(len(times), len(rows))}{_of_seeds(rows)}{median}"


def _of_seeds(rows: Sequence[EpisodeRow]) -> str:
    """Goals reached with each training seed, in order: " 9, 8, 10"; "" with one."""
    seeds = sorted({row.seed for row in rows})
    groups = [[row.reached for row in rows if row.seed == seed] for seed in seeds]
    if len(groups) < 2:
        return ""
    even = len({len(group) for group in groups}) == 1
    shown = (f"{sum(group)}" if even else f"{sum(group)} of {len(group)}" for group in groups)
    return f": {', '.join(shown)}"


def _setting(row: EpisodeRow) -> tuple[str, str, str, str, str]:
    return row.run, row.model, row.where, row.hidden, row.told


def _walked(
    run: str, seed: int, model: str, where: str, navigation: Navigation
) -> Iterator[EpisodeRow]:
    for number, walk in enumerate(navigation.walks):
        yield EpisodeRow(
            run=run,
            seed=seed,
            model=model,
            digest="",
            where=where,
            told="",
            hidden="",
            task_seed=walk.seed or number,
            reached=walk.reached,
            seconds=walk.seconds,
            distance=walk.distance,
        )


def _short(errors: Errors | None) -> tuple[float, float]:
    if errors is None or errors.short.diverged:
        return math.nan, math.nan
    return errors.short.e_pos_rmse, errors.short.e_rot
