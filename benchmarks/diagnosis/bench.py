"""Hide effects in recordings of another simulator, have them diagnosed, and count."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from benchmarks.diagnosis.case_result import CaseResult
from benchmarks.diagnosis.case_row import CaseRow
from benchmarks.diagnosis.cases import GROUPS, MESSY_GROUPS, Case, cases
from benchmarks.diagnosis.cases import Group as CaseGroup
from benchmarks.diagnosis.examiner import Examiner
from benchmarks.diagnosis.publishing import publish_examination
from benchmarks.diagnosis.rates import Line, summary
from flywheel.cli.console import console, table
from flywheel.cli.models import open_trained
from flywheel.cli.options import number
from flywheel.errors import ConfigError, DataError
from flywheel.evaluation.intervals import Interval
from flywheel.files import read_json
from flywheel.outputs import check_folder, write_output
from flywheel.quantities import TYPICAL_SIZES
from flywheel.registry import lookup
from flywheel.robots import ROBOTS, load_robot
from flywheel.runtime.pool.interrupts import StopRequest
from flywheel.runtime.pool.jobs import Group, Job
from flywheel.runtime.pool.pool import Patience, WorkerPool
from flywheel.runtime.pool.progress import console_progress
from flywheel.runtime.pool.ray_backend import Cluster, RayBackend
from flywheel.runtime.tracking.mlflow_client import Board
from flywheel.runtime.tracking.tracker import TrackingConfig
from flywheel.runtime.workers.model_weights import TrainedModel
from flywheel.truth_simulator.built_robot import Spread
from flywheel.validation import validated

LONGEST = 1800.0  # without a sign of progress, a case is begun again [s]


def examine(
    folder: Path,
    robot: str,
    groups: Sequence[str],
    sizes: Sequence[float],
    seeds: Sequence[int],
    only: str,
    model: str | None,
    address: str | None,
    spread: float = 1.0,
    told: bool = False,
) -> None:
    """Examine the cases that the folder has no result of yet, and show the table of all.

    It is printed, written to `table.md`, and logged to the MLflow database of the folder.

    Args:
      folder: one JSON file per case.
      robot, groups, sizes, seeds, spread: cases; see `benchmarks.diagnosis.cases`.
      only: part of the names of the cases.
      model: tested instead of the plant; see `flywheel.cli.models`.
      address: of an existing Ray cluster.
      told: the diagnosis knows the deviations of messy robots.
    """
    lookup(ROBOTS, robot, "robot")  # workers load it by its name
    made = cases(load_robot(robot), _checked(groups), sizes, seeds, spread=spread)
    wanted = [case for case in made if only in case.name]
    if not wanted:
        raise ConfigError(f"No case of {robot} has {only!r} in its name.")
    check_folder(folder, "folder of the results")
    folder.mkdir(parents=True, exist_ok=True)
    tested = None if model is None else open_trained(model, load_robot(robot))
    missing = [case for case in wanted if not _file(folder, case.name).exists()]
    _kept(folder, wanted, tested, told)
    if missing:
        known = Spread().times(spread) if told else None
        _examine(folder, missing, tested, known, address)
    lines = summary([CaseRow.of(result) for result in _kept(folder, wanted, tested, told)])
    show(lines)
    written = write_table(lines, folder / "table.md")
    board = Board(folder, TrackingConfig(), robot)
    publish_examination(board, f"diagnose-bench-{robot}", lines, [written.absolute()])


def listed(sizes: str) -> list[float]:
    """Sizes from "0.5,1,2", in typical sizes.

    Raises:
      ConfigError: one is invalid.
    """
    return [number(size, "Each of --sizes", TYPICAL_SIZES) for size in sizes.split(",")]


def _stored(file: Path) -> CaseResult:
    values = read_json(file, "result of a case", DataError)
    return validated(CaseResult, values, f"{file} is not a result of a case", DataError)


def _kept(
    folder: Path, wanted: Sequence[Case], tested: TrainedModel | None, told: bool
) -> list[CaseResult]:
    """The results in the folder.

    Raises:
      ConfigError: they are of another model, or of a diagnosis with other information.
    """
    files = [_file(folder, case.name) for case in wanted]
    results = [_stored(file) for file in files if file.exists()]
    digest = "" if tested is None else tested.weights.digest
    for result in results:
        if result.model != digest:
            raise ConfigError(
                f"{folder} has results of {result.model[:12] or 'the plant'}; {digest[:12] or 'the plant'} "
                "is to be tested now. Give another folder."
            )
        if result.told != told:
            was = "was" if result.told else "was not"
            raise ConfigError(
                f"{folder} has results of a diagnosis that {was} told how far off robots are. Give another "
                "folder."
            )
    return results


def _examine(
    folder: Path,
    missing: Sequence[Case],
    model: TrainedModel | None,
    told: Spread | None,
    address: str | None,
) -> None:
    cores = len(os.sched_getaffinity(0))
    with (
        Cluster(address, cores) as ray,
        StopRequest() as stop,
    ):
        groups = [Group("examiner", Examiner, (model, told), count=ray.cpus)]
        ray.check_fits(groups)
        pool = WorkerPool(RayBackend(), groups, ray.cpus, Patience(stall=LONGEST), stop)
        try:
            jobs = [Job(case.name, "examiner", "examine", (case,)) for case in missing]
            pool.run(jobs, lambda job, result: _keep(folder, result), console_progress(), "examine")
        finally:
            pool.close()


def _keep(folder: Path, result: CaseResult) -> None:
    write_output(_file(folder, result.name), result.model_dump_json(indent=1) + "\n")


def _file(folder: Path, name: str) -> Path:
    return folder / f"{name}.json"


def _checked(names: Sequence[str]) -> list[CaseGroup]:
    known = (*GROUPS, *MESSY_GROUPS)
    if unknown := [name for name in names if name not in known]:
        raise ConfigError(f"There is no group {unknown[0]!r}. Known: {', '.join(known)}.")
    return [group for group in known if group in names]


COLUMNS = (
    "hidden", "#cases", "#right", "#first right", "#place aside", "#truth among answers", "#too small",
    "#said outside", "#answers",
    "size error", "#in interval", "held out / noise before", "after", "#explained", "[s]", "verdicts",
)  # fmt: skip


def show(lines: Sequence[Line]) -> None:
    """Print the table."""
    out = console()
    out.width = max(out.width, 220)
    out.print(_table(lines))


def write_table(lines: Sequence[Line], path: Path) -> Path:
    """Write the table as Markdown."""
    made = _table(lines)
    made.box, made.title = box.MARKDOWN, None
    out = Console(width=1000)
    with out.capture() as printed:
        out.print(made)
    rows = [row.strip() for row in printed.get().splitlines() if row.strip()]
    return write_output(path, "\n".join(rows) + "\n")


def _table(lines: Sequence[Line]) -> Table:
    return table("hidden effects", COLUMNS, [_row(line) for line in lines])


def _row(line: Line) -> tuple[object, ...]:
    return (
        line.what,
        line.cases,
        _share(line.right),
        _share(line.first),
        _share(line.family),
        _share(line.contained),
        line.unseen,
        _share(line.outside),
        line.answers,
        line.size_error,
        _share(line.coverage),
        line.held_out_before,
        line.held_out_after,
        _share(line.explained),
        line.seconds,
        ", ".join(f"{name} {count}" for name, count in line.verdicts.items()),
    )


def _share(interval: Interval) -> str:
    if interval.value != interval.value:
        return "-"
    return f"{interval.value:.0%} ({interval.low:.0%}-{interval.high:.0%})"
