"""`flywheel run`: turn the flywheel, and show what came of it."""

from __future__ import annotations

import shlex
from pathlib import Path

from flywheel.cli.show import Out, console, table
from flywheel.files import file_name
from flywheel.reports.page import PAGE_FILE
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.loop import run
from flywheel.runtime.pool.progress import console_progress
from flywheel.runtime.results import ErrorNumbers, Errors, Navigation, RunResult
from flywheel.runtime.run.folder import name_of
from flywheel.runtime.tracking.dashboard import DATABASE

RUNS = Path("runs")


def turn(
    config: Path, overrides: list[str], *, resume: bool, address: str | None, folder: Path | None
) -> None:
    """Run, then print a summary and where to look.

    Args:
      config: YAML file.
      overrides: "key=value" on top of it.
      resume: go on with the run in the folder.
      address: of an existing Ray cluster.
      folder: of the run; by default runs/<name of the file>.
    """
    settings = load_config(config, overrides)
    place = folder or RUNS / file_name(config.stem)
    result = run(settings, place, resume=resume, address=address, progress=console_progress())
    show_summary(console(), result, place)


def show_summary(out: Out, result: RunResult, folder: Path) -> None:
    """One line per model, the lines they are judged by, and where the rest is."""
    out.print(table(f"{result.name}: {result.robot}", COLUMNS, summary_rows(result)))
    for note in result.notes:
        out.say(note)
    out.say(f"Page:      {folder / PAGE_FILE}")
    if (folder / DATABASE).exists():
        out.say(f"Dashboard: flywheel ui {shlex.quote(str(folder))}")


COLUMNS = (
    "model",
    "e_pos RMSE/L [%]",
    "e_rot [deg]",
    "full e_pos RMSE/L [%]",
    "full e_rot [deg]",
    "#reached",
    "time to goal [s]",
    "champion",
)


def summary_rows(result: RunResult) -> list[tuple[object, ...]]:
    """Errors on the pooled tests and success, of every model, floors, persistence and oracle."""
    rows = [
        (
            name_of(each.iteration, each.arm),
            *_errors(result.test_errors(each)),
            *_success(each.navigation),
            "yes" if each.gate is not None and each.gate.promoted else "no",
        )
        for each in result.iterations
    ]
    beside = [
        ("persistence", *_errors(result.persistence), None, None, ""),
        ("floor (MuJoCo)", *_errors(result.floor), None, None, ""),
        ("informed floor", *_errors(result.informed_floor), None, None, ""),
        ("oracle (MPPI)", *_errors(None), *_success(result.oracle), ""),
        *(
            (f"champion, {each.course}", *_errors(None), *_success(each.navigation), "")
            for each in result.unseen
        ),
    ]
    return [*rows, *(row for row in beside if any(cell is not None for cell in row[1:-1]))]


def _errors(errors: Errors | None) -> tuple[float | str | None, ...]:
    if errors is None:
        return (None,) * 4
    return (*_totals(errors.short), *_totals(errors.full))


def _totals(numbers: ErrorNumbers | None) -> tuple[float | str | None, ...]:
    if numbers is None:
        return None, None
    if numbers.diverged:
        return "diverged", "diverged"
    return numbers.e_pos_rmse, numbers.e_rot


def _success(navigation: Navigation | None) -> tuple[str | None, float | None]:
    if navigation is None:
        return None, None
    success = navigation.success
    return f"{success.reached}/{success.total}", navigation.median_seconds
