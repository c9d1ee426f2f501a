"""`flywheel recordings import`: make episodes from logs."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from flywheel.cli.console import Out, console, table
from flywheel.cli.recordings.opening import AsJson, robot_of, show_setting, store_at
from flywheel.options import ImportOptions
from flywheel.outputs import printable, write_output

if TYPE_CHECKING:
    from flywheel.data import TrajectoryStore
    from flywheel.data.recordings import Aligned, Imported, ImportReport, RecordingMap, Told
    from flywheel.records import Split
    from flywheel.runtime.pool.progress import Progress, Stage

ROOM = 3_000_000  # coordinates that are kept until all logs are read; the others are read again


def import_(
    logs: Annotated[tuple[Path, ...], "[LOG]..."] = (),
    *,
    store: Annotated[Path, "RUN_OR_STORE"],
    robot: str | None = None,
    options: ImportOptions = ImportOptions(),
    map_file: Annotated[Path | None, "--map"] = None,
    align_plot: Path | None = None,
    dry_run: Annotated[bool, "--dry-run"] = False,
    as_json: AsJson = False,
) -> None:
    """Make episodes from logs, and report masked, repaired or resampled samples.

    The format of a log is told by its content, see docs/recordings.md. If one cannot be used, none is
    stored.

    [bold]Examples[/bold]

    flywheel recordings import monday.csv --robot prism3 --store runs/prism3/store --dry-run

    flywheel recordings import --split test --map monday.yaml --robot my.xml --store mine

    Args:
      logs: Files; none if the map names them (files).
      store: A run's folder, or a folder of episodes; made if missing.
      robot: Your .xml, or a shipped robot's name; by default the run's.
      map_file: YAML with names, units and axes for all of them; by default the one of the same name next
        to each.
      align_plot: Output file (.png): cables by winches and by points (align: auto).
      dry_run: Read and report, but store nothing.
    """
    from flywheel.data.recordings import read_map, read_recording
    from flywheel.dynamics.plant import cables_by_winches
    from flywheel.outputs import check_outputs

    check_outputs({"plot": align_plot}, logs)
    owner = robot_of(store, robot)
    place = None if dry_run else store_at(store)
    how = read_map(map_file) if map_file else None

    def read(log: Path) -> Imported:
        with _progress().stage(escape(printable(log.name)), 1.0) as stage:
            told = _told(stage)
            return read_recording(log, owner, options, how=how, told=told, follow=cables_by_winches)

    found = _read_all(_named(logs, map_file, how), read, keep=not dry_run)
    if align_plot is not None:
        _write_plot(align_plot, [cable for one in found for cable in one.compared])
    outcomes = [("not stored (dry run)", "") for _ in found]
    if place is not None:
        outcomes = [_stored(place, one, read) for one in found]
    _show_imported(found, outcomes, as_json)


@dataclass(frozen=True)
class Read:
    """A log that was read and accepted.

    Attributes:
      path: of the file.
      report: findings in it.
      split: of its episodes.
      imported: the episodes, unless they would take too much memory together with those of the
        other logs.
      compared: cables by which clocks of files were found.
    """

    path: Path
    report: ImportReport
    split: Split
    imported: Imported | None
    compared: tuple[Aligned, ...]


def _named(logs: Sequence[Path], map_file: Path | None, how: RecordingMap | None) -> Sequence[Path]:
    """The logs that were given, or the map that names them.

    Raises:
      DataError: neither, or both.
    """
    from flywheel.errors import DataError

    files = how is not None and bool(how.files)
    if logs and files:
        raise DataError(f"The map {map_file} names its files: give no other logs beside it.")
    if logs:
        return logs
    if not files or map_file is None:
        raise DataError("Give a log, or a map that names them (--map, files).")
    return [map_file]


def _progress() -> Progress:
    """Bars on a terminal; nothing in logs and pipes."""
    from flywheel.runtime.pool.progress import Bars, Quiet

    errors = Console(stderr=True)
    return Bars(errors) if errors.is_terminal else Quiet()


def _told(stage: Stage) -> Told:
    """Shows the share of a file that is read, and the speed."""
    from flywheel.files import MB

    began = time.monotonic()

    def told(read: int, total: int) -> None:
        rate = read / MB / max(time.monotonic() - began, 1e-3)
        stage.update(read / max(total, 1), f"{rate:.0f} MB/s" if read < total else "now checked")

    return told


def _read_all(logs: Sequence[Path], read: Callable[[Path], Imported], keep: bool) -> list[Read]:
    """Read all logs.

    Args:
      logs: their files.
      read: reader of one log.
      keep: the episodes, as far as there is room.

    Raises:
      DataError: with the faults of all unusable logs; or one log is given twice.
    """
    from flywheel.errors import DataError, FlywheelError

    found, wrong, room = [], [], ROOM
    for path in logs:
        try:
            one = read(path)
        except FlywheelError as error:
            wrong.append(str(error))
            continue
        room -= sum(episode.trajectory.observations.points.size for episode in one.episodes)
        kept = keep and (room >= 0 or len(logs) == 1)
        imported = one if kept else None
        found.append(Read(path, one.report, one.episodes[0].split, imported, one.compared))
    if wrong:
        others = f"\nNothing was stored of the {len(logs)} logs." if len(logs) > 1 else ""
        raise DataError("\n".join(wrong) + others)
    files: dict[str, str] = {}
    for report in (one.report for one in found):
        other = files.setdefault(report.digest, report.file)
        if other != report.file:
            raise DataError(f"{other} and {report.file} are the same log; give it once.")
    return found


def _write_plot(path: Path, cables: Sequence[Aligned]) -> None:
    """Write a picture of the cables by which clocks were found.

    Raises:
      DataError: there are none.
    """
    from flywheel.errors import DataError
    from flywheel.reports.alignment_figure import alignment_figure
    from flywheel.reports.pictures import as_file

    content = as_file(lambda: alignment_figure(cables), "png")
    if content is None:
        raise DataError("--align-plot shows clocks that were found: no file has align: auto.")
    write_output(path, content)


def _stored(store: TrajectoryStore, log: Read, read: Callable[[Path], Imported]) -> tuple[str, str]:
    from flywheel.data.recordings import store_recording
    from flywheel.errors import DataError

    one = log.imported or read(log.path)
    if one.report.digest != log.report.digest:
        raise DataError(f"{log.report.file} changed since it was read; it was not stored.")
    segment, new = store_recording(store, one)
    return ("stored" if new else f"stored already, as {segment}"), segment


def _show_imported(
    found: Sequence[Read], outcomes: Sequence[tuple[str, str]], as_json: bool
) -> None:
    """Print the result of each log: (state, segment), the segment "" if it was not stored."""
    if as_json:
        shown = [_as_json(one, *outcome) for one, outcome in zip(found, outcomes, strict=True)]
        typer.echo(json.dumps(shown, indent=1))
        return
    out = console()
    for one, (state, _) in zip(found, outcomes, strict=True):
        _show(out, one, state)
    segments = [segment for _, segment in outcomes if segment]
    if segments:
        show_setting(out, segments)


def _as_json(log: Read, state: str, segment: str) -> dict[str, Any]:
    return {"state": state, "segment": segment, "split": log.split, **asdict(log.report)}


def _show(out: Out, log: Read, state: str) -> None:
    from flywheel.data.recordings import counted

    report = log.report
    out.print(
        f"[bold]{escape(report.file)}[/bold]: {report.rows} rows, {report.seconds:.4g} s at "
        f"{1 / report.period:.4g} Hz; {100 * report.seen:.4g} % of the points' samples can be used; "
        f"{counted(len(report.episodes), 'episode')} for {log.split}; {state}",
        highlight=False,
        soft_wrap=True,
    )
    if not report.findings:
        out.print("Nothing was masked, repaired or resampled.")
        return
    heads = ("found", "done", "marker or column", "#count", "at [s]", "how")
    found = report.findings
    cells = [(f.kind, f.action, f.subject or "(all)", f.count, f.when, f.words) for f in found]
    out.print(table(f"Changes to {report.file}", heads, cells))
