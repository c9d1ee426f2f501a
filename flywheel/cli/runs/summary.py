"""`flywheel summary`: several runs of one configuration, with different seeds, in one table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from flywheel.cli.console import console, table

if TYPE_CHECKING:
    from flywheel.reports.seeds import SeedRow

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


def summary(runs: Annotated[list[Path], "RUN..."]) -> None:
    """Compare several seeds of one configuration in one table.

    Shows means over the runs with the lowest and the highest value, and success over all tasks.

    [bold]Examples[/bold]

    flywheel run prism3 seed=1 --folder runs/prism3-1

    flywheel summary runs/prism3 runs/prism3-1

    Args:
      runs: Folders of runs with different seeds.
    """
    from flywheel.reports.seeds import summarise
    from flywheel.results import RunResult

    rows = summarise([RunResult.load(run) for run in runs])
    title = f"{len(runs)} seeds: mean (lowest-highest)"
    console().print(table(title, COLUMNS, [_cells(row) for row in rows]))


def _cells(row: SeedRow) -> tuple[object, ...]:
    from flywheel.reports.conclusions import rate

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
