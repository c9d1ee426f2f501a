"""`flywheel recordings`: logs of real robots into a store, and episodes out of it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from flywheel.cli.app import App
from flywheel.cli.console import Out, console, table
from flywheel.options import ImportOptions
from flywheel.outputs import check_folder, check_new, printable, write_output

if TYPE_CHECKING:
    from flywheel.data import TrajectoryStore
    from flywheel.data.recordings import Aligned, Imported, ImportReport, RecordingMap, Told
    from flywheel.records import Split
    from flywheel.robots import Robot
    from flywheel.runtime.pool.progress import Progress, Stage

app = App(no_args_is_help=True, help="Import and export logs of real robots.")

ROOM = 3_000_000  # coordinates that are kept until all logs are read; the others are read again

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
StoreArgument = Annotated[
    Path, typer.Argument(metavar="RUN_OR_STORE", help="A run's folder, or a folder of episodes.")
]


@app.command("import")
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
    owner = _robot(store, robot)
    place = None if dry_run else _store(store)
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


@app.command()
def guess(
    logs: Annotated[list[Path], "LOG..."],
    *,
    robot: str,
    output: Annotated[Path | None, "--output", "-o"] = None,
) -> None:
    """Write a draft of the map of a recording, to be read and completed.

    Names are taken from the files, winches also from what the cables do.

    [bold]Example[/bold]

    flywheel recordings guess take.csv motors.txt --robot my.xml --output monday.yaml

    Args:
      logs: Files of one recording.
      robot: Your .xml, or a shipped robot's name.
      output: New file; printed if missing.
    """
    from flywheel.data.recordings import guess as guessed
    from flywheel.robots import load_robot

    if output is not None:
        check_new(output)
    text = guessed(logs, load_robot(robot), Path() if output is None else output.parent)
    if output is None:
        typer.echo(text, nl=False)
        return
    write_output(output, text)
    console().say(f"{output}: a draft; read its remarks, complete it, and import it with --map.")


@app.command()
def show(store: StoreArgument, *, as_json: AsJson = False) -> None:
    """Show the recordings in a store, and the setting that makes a run learn from them.

    [bold]Example[/bold]

    flywheel recordings show runs/prism3/store
    """
    from flywheel.cli.runs.data import open_store

    opened = open_store(store)
    rows = _stored_rows(opened)
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
    else:
        _show_stored(opened, rows)


@app.command()
def export(
    store: StoreArgument,
    episode: Annotated[str, "EPISODE"],
    output: Annotated[Path, "OUT"],
    *,
    robot: str | None = None,
) -> None:
    """Write an episode, recorded or simulated, as CSV or MCAP, or several as a LeRobot data set.

    [bold]Examples[/bold]

    flywheel recordings export runs/prism3 i0001-mppi-collect-0000 episode.csv

    flywheel recordings export runs/prism3 'i0001-*' prism3-lerobot

    Args:
      episode: Its name; for LeRobot also a pattern: 'i0001-*'.
      output: New .csv or .mcap; a name without an ending is a LeRobot data set.
      robot: Your .xml, or a shipped robot's name; by default the run's.
    """
    from flywheel.cli.runs.data import open_store
    from flywheel.data.recordings import write_recording
    from flywheel.data.recordings.exports import write_lerobot, write_mcap
    from flywheel.errors import DataError

    writers = {".csv": write_recording, ".mcap": write_mcap}
    if output.suffix not in ("", *writers):
        raise DataError(
            f"The ending of {output} must be {' or '.join(writers)}, or none for a LeRobot data set; got "
            f"{output.suffix!r}."
        )
    owner, opened = _robot(store, robot), open_store(store)
    if output.suffix:
        write = writers[output.suffix]
        found = opened.read(episode)
        left = write(found, output, owner)
        steps = found.trajectory.steps
        words = f"{steps + 1} rows, {steps * found.trajectory.dt:g} s."
    else:
        names = _matching(opened, episode)
        frames, left = write_lerobot(map(opened.read, names), output, owner)
        words = f"{len(names)} episodes, {frames} frames."
    out = console()
    out.say(f"{output}: {words}")
    if left:
        out.say(f"A log cannot contain: {', '.join(left)}; {output} does not have it.")


def _matching(store: TrajectoryStore, pattern: str) -> list[str]:
    """Names of the episodes that match a pattern, those of one split together.

    Raises:
      DataError: none does.
    """
    from flywheel.errors import DataError

    every = [one for segment in store.committed() for one in store.episodes(segment)]
    found = [one for one in every if fnmatchcase(one.id, pattern)]
    if not found:
        raise DataError(f"No episode in {store.url} is named {pattern!r}.")
    return [one.id for one in sorted(found, key=lambda one: (one.split, one.id))]


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
        _show_setting(out, segments)


def _stored_rows(store: TrajectoryStore) -> list[dict[str, Any]]:
    """The recordings of a store, as plain values."""
    from flywheel.data.recordings import stored_recordings

    rows: list[dict[str, Any]] = []
    for segment, summaries in stored_recordings(store).items():
        for summary, episode in zip(summaries, store.read_segment(segment), strict=True):
            about = {name: getattr(summary, name) for name in ("split", "seconds", "dt", "robot")}
            seen = float(episode.trajectory.observations.valid.mean())
            rows.append(
                {"episode": summary.id, "segment": segment, **about, "points_seen": seen}
                | {"conditions": episode.provenance.conditions}
            )
    return rows


def _show_stored(store: TrajectoryStore, rows: Sequence[dict[str, Any]]) -> None:
    out = console()
    if not rows:
        out.say(f"There is no recording in {store.url}.")
        return
    heads = (
        "episode",
        "split",
        "duration [s]",
        "dt [s]",
        "points there [%]",
        "robot",
        "conditions",
    )
    keys = ("episode", "split", "seconds", "dt", "points_seen", "robot", "conditions")
    short = ({"points_seen": 100 * r["points_seen"], "robot": r["robot"][:12]} for r in rows)
    cells = [[(row | less)[key] for key in keys] for row, less in zip(rows, short, strict=True)]
    out.print(table(f"Recordings in {store.url}", heads, cells))
    _show_setting(out, list(dict.fromkeys(row["segment"] for row in rows)))


def _robot(place: Path, name: str | None) -> Robot:
    """The given robot, else that of the run."""
    from flywheel.errors import DataError
    from flywheel.robots import load_robot

    if name is not None:
        return load_robot(name)
    if not _is_run(place):
        raise DataError(
            f"{place} is not a run's folder: give the robot of the episodes with --robot."
        )
    from flywheel.runtime.run.folder import RunFolder

    folder = RunFolder(place)
    return folder.robot(folder.config())


def _store(place: Path) -> TrajectoryStore:
    """The store of a run, or the one at a path; a new one if there is nothing."""
    from flywheel.data import TrajectoryStore

    check_folder(place, "store")
    if _is_run(place):
        from flywheel.cli.runs.data import open_store

        return open_store(place)
    return TrajectoryStore(str(place))


def _is_run(place: Path) -> bool:
    """True for a run's folder, without importing its classes, which takes seconds."""
    return (place / "config.yaml").exists()


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


def _stored(store: TrajectoryStore, log: Read, read: Callable[[Path], Imported]) -> tuple[str, str]:
    from flywheel.data.recordings import store_recording
    from flywheel.errors import DataError

    one = log.imported or read(log.path)
    if one.report.digest != log.report.digest:
        raise DataError(f"{log.report.file} changed since it was read; it was not stored.")
    segment, new = store_recording(store, one)
    return ("stored" if new else f"stored already, as {segment}"), segment


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


def _show_setting(out: Out, segments: Sequence[str]) -> None:
    """The setting that makes a run learn from segments."""
    listed = ",".join(segments)
    out.say(f"A run on this store learns from them with 'collect.recordings=[{listed}]'")
