"""The controller in the loop: runs of one configuration, one per seed, as a page with a picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.navigation import episodes_of, models_of
from benchmarks.rows import write_rows
from flywheel.errors import ConfigError
from flywheel.outputs import write_output
from flywheel.reports import style
from flywheel.reports.conclusions import rate
from flywheel.reports.pictures import as_file
from flywheel.reports.seeds import SeedRow, Spread, summarise
from flywheel.results import RESULT_FILE, RunResult, Success
from flywheel.runtime.config.run_config import RunConfig, decisive, load_config
from flywheel.runtime.config.shipped import config_file
from flywheel.runtime.loop import run
from flywheel.runtime.pool.progress import Progress, Quiet
from flywheel.runtime.run.folder import RunFolder

LOOP = "loop"
CONFIGS = {"": "s_course", "paper": "paper/s_course", "smoke": "smoke_course"}  # by size
TITLES = ("model", "reached", "median [s]", "MSE/L [%]", "RMSE/L [%]", "turn [deg]", "published")
PUBLISHED = {  # in words: the publication has the numbers in a picture only
    "iteration 1": "better than 0",
    "iteration 2": "better than 1",
    "iteration 3": "slightly worse than 2",
    "maze, never seen": "reached",
}
BESIDE = {
    "floor": style.FLOOR_LINE,
    "informed floor": style.INFORMED_LINE,
    "oracle": style.ORACLE_LINE,
}
# A number and the ends of its interval, or of its spread over seeds.
Ends = tuple[float, float, float]
PANELS: dict[str, Callable[[SeedRow], Ends | None]] = {
    "goals reached in time [%]": lambda row: _rate(row.success),
    "median time to the goal [s]": lambda row: _once(row.seconds),
    "position error, MSE/L [%]": lambda row: _ends(row.e_pos_mse),
    "rotation error [deg]": lambda row: _ends(row.e_rot),
}


def make_loop(
    size: str,
    overrides: Sequence[str],
    folder: Path,
    address: str | None,
    progress: Progress = Quiet(),
) -> Path:
    """Run the loop with one seed, or continue that, and show it with the others of the folder.

    Args:
      size: a key of `CONFIGS`.
      overrides: `key=value`, of the run.
      folder: with a run for each seed, the page, its picture and numbers.
      address: of an existing Ray cluster.
      progress: display for people.

    Returns:
      The page.

    Raises:
      ConfigError: the folder has runs with other settings.
      FlywheelError: see `flywheel.runtime.loop.run`.
    """
    config = load_config(config_file(CONFIGS[size]), overrides)
    own = folder / f"s{config.seed}"
    for other in _runs(folder):
        begun = RunFolder(other.absolute()).config()
        if other != own and _without_seed(begun) != _without_seed(config):
            raise ConfigError(f"{other} is a run with other settings. Give another folder.")
    run(config, own, resume=True, address=address, progress=progress)
    found = [RunResult.load(path) for path in _runs(folder)]
    return publish([result for result in found if result.finished], folder)


def publish(runs: Sequence[RunResult], folder: Path) -> Path:
    """Write the page of finished runs, its picture, and their numbers as CSV."""
    rows = summarise(runs)
    write_rows(folder / "models.csv", [row for each in runs for row in models_of(LOOP, each)])
    write_rows(folder / "episodes.csv", [row for each in runs for row in episodes_of(LOOP, each)])
    picture = as_file(lambda: over_iterations(rows), "png")
    assert picture is not None
    write_output(folder / "loop.png", picture)
    return write_output(folder / "table.md", "\n".join(page(runs, rows)) + "\n")


def page(runs: Sequence[RunResult], rows: Sequence[SeedRow]) -> list[str]:
    """Lines of Markdown: success, times and pooled errors of each model, beside what was published."""
    task, horizon = runs[0].config["task"], runs[0].config["evaluate"]["horizon_seconds"]
    seeds = "s" * (len(runs) > 1) + " " + ", ".join(str(each.config["seed"]) for each in runs)
    lines = [
        "# loop",
        "",
        f"{runs[0].robot} on the course {task['course']}, seed{seeds}. Iteration 0 learned from random "
        "controls and drops, each later one also from drives with the model before it; the control arm "
        "from random controls instead. The oracle plans on the plant. A goal counts if reached within "
        f"{task['seconds']:g} s; intervals are Wilson's of 95 %. Errors are over {horizon:g} s, on the test "
        "episodes of all iterations, as mean (lowest-highest) over seeds; MSE is summed over x, y, z, and "
        "divided by L.",
        "",
        "![Success, time and errors over iterations](loop.png)",
        "",
        f"| {' | '.join(TITLES)} |",
        "|---" * len(TITLES) + "|",
    ]
    return lines + [f"| {' | '.join(_cells(row))} |" for row in rows]


def over_iterations(rows: Sequence[SeedRow]) -> Figure:
    """Success, median time and pooled errors of each iteration's model, beside floors and ceiling."""
    turns = [row for row in rows if row.name.removeprefix("iteration ").isdigit()]
    figure = Figure(figsize=(9.2, 5.6))
    for axes, (title, ends) in zip(figure.subplots(2, 2).flat, PANELS.items(), strict=True):
        values = np.array([ends(row) or (math.nan,) * 3 for row in turns])
        reach = np.abs(values[:, 1:] - values[:, :1]).T
        axes.errorbar(
            range(len(turns)), values[:, 0], reach, None, "o-", color=style.MPPI, capsize=4
        )
        for row in rows:
            if row.name in BESIDE and (beside := ends(row)) is not None:
                axes.axhline(beside[0], label=row.name, **BESIDE[row.name])
        axes.set_ylim(0, 1.08 * axes.get_ylim()[1])
        axes.set_ylabel(title)
        if axes.get_legend_handles_labels()[0]:
            axes.legend()
        style.whole_steps(axes, list(range(len(turns))))
    figure.axes[0].set_ylim(0, 105)
    return figure


def _rate(success: Success | None) -> Ends | None:
    if success is None:
        return None
    low, high = success.interval
    return 100 * success.rate, 100 * low, 100 * high


def _once(value: float | None) -> Ends | None:
    return None if value is None else (value, value, value)


def _ends(spread: Spread | None) -> Ends | None:
    return None if spread is None else (spread.mean, spread.low, spread.high)


def _cells(row: SeedRow) -> tuple[str, ...]:
    errors = (row.e_pos_mse, row.e_pos_rmse, row.e_rot)
    return (
        row.name,
        "" if row.success is None else rate(row.success),
        "" if row.seconds is None else f"{row.seconds:.1f}",
        *("" if e is None else str(e) if math.isfinite(e.mean) else "diverged" for e in errors),
        PUBLISHED.get(row.name, ""),
    )


def _runs(folder: Path) -> list[Path]:
    """The folders of its runs with a result, by seed."""
    return sorted(file.parent for file in folder.glob(f"s*/{RESULT_FILE}"))


def _without_seed(config: RunConfig) -> dict[str, Any]:
    return decisive(config.model_copy(update={"seed": 0}))
