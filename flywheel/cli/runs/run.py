"""`flywheel run`: run the loop, and show its results."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from flywheel.cli.console import Out, console, table
from flywheel.cli.options import Overrides

if TYPE_CHECKING:
    from flywheel.results import ErrorNumbers, Errors, Navigation, RunResult

RUNS = Path("runs")


def run(
    config: str,
    overrides: Overrides = (),
    *,
    resume: Annotated[bool, "--resume"] = False,
    address: str | None = None,
    folder: Path | None = None,
) -> None:
    """Run the loop: collect, train, evaluate, decide, repeatedly.

    [bold]Examples[/bold]

    flywheel run smoke [dim](minutes; a test of everything)[/dim]

    flywheel run prism3 seed=1 iterations=3

    flywheel run configs/my_own.yaml --resume [dim](after Ctrl-C, a crash, a power cut)[/dim]

    Args:
      config: A shipped configuration, e.g. prism3 (flywheel list configs), or a YAML file.
      resume: Continue the run in the folder, from its files.
      address: An existing Ray cluster (host:port, auto); by default one is started here.
      folder: Folder of the run; runs/<name of the configuration> by default.
    """
    from flywheel.files import file_name
    from flywheel.runtime import loop
    from flywheel.runtime.config.run_config import load_config
    from flywheel.runtime.config.shipped import config_file
    from flywheel.runtime.pool.progress import console_progress

    settings = load_config(config_file(config), overrides)
    place = folder or RUNS / file_name(run_name(config))
    progress = console_progress()
    result = loop.run(settings, place, resume=resume, address=address, progress=progress)
    show_result(console(), result, place)


def run_name(config: str) -> str:
    """The name of a run: that of the file, or of the shipped configuration ("paper-prism3")."""
    path = Path(config)
    return path.stem if path.suffix in (".yaml", ".yml") else config.replace("/", "-")


def show_result(out: Out, result: RunResult, folder: Path) -> None:
    """Print a line per model, the lines for comparison, and the paths of the rest."""
    from flywheel.reports.page import PAGE_FILE
    from flywheel.runtime.tracking.dashboard import DATABASE

    out.print(table(f"{result.name}: {result.robot}", COLUMNS, _rows(result)))
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
    "became champion",
)


def _rows(result: RunResult) -> list[tuple[object, ...]]:
    """Errors on the pooled tests and success, of every model, floors, persistence and oracle."""
    from flywheel.runtime.run.folder import name_of

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
