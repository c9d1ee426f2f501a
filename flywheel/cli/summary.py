"""`flywheel summary`: several runs of one configuration, with different seeds, in one table."""

from __future__ import annotations

from pathlib import Path

from flywheel.cli.show import console, table
from flywheel.reports.seeds import SeedRow, summarise
from flywheel.reports.verdicts import rate
from flywheel.runtime.results import RunResult

COLUMNS = (
    "model",
    "e_pos MSE/L [%]",
    "e_pos RMSE/L [%]",
    "e_rot [deg]",
    "full RMSE/L [%]",
    "full e_rot [deg]",
    "goals reached",
    "median [s]",
)


def show_seeds(runs: list[Path]) -> None:
    """Print means over the runs with lowest and highest, and success over all tasks."""
    rows = summarise([RunResult.load(run) for run in runs])
    out = console()
    out.print(table(f"{len(runs)} seeds: mean (lowest-highest)", COLUMNS, map(_cells, rows)))


def _cells(row: SeedRow) -> tuple[object, ...]:
    return (
        row.name,
        row.e_pos_mse,
        row.e_pos_rmse,
        row.e_rot,
        row.full_rmse,
        row.full_rot,
        None if row.success is None else rate(row.success),
        row.seconds,
    )
