"""`flywheel recordings`: logs of real robots into a store, and episodes out of it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import typer
from rich.console import Console

from flywheel.data import TrajectoryStore
from flywheel.data.recordings import (
    Imported,
    ImportReport,
    counted,
    read_map,
    read_recording,
    store_recording,
    stored_recordings,
    write_recording,
)
from flywheel.errors import DataError, FlywheelError
from flywheel.outputs import check_folder
from flywheel.records import Split
from flywheel.robots import Robot, load_robot
from flywheel.runtime.run_folder import RunFolder
from pipelines.data import open_store
from pipelines.show import console, table


def import_logs(
    logs: Sequence[Path],
    place: Path,
    robot_name: str | None,
    split: str | None,
    dt: float,
    mapping: Path | None,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Read all logs, and only if all can be used, store them; print what became of each.

    Raises:
      DataError: a log cannot be used; the others are not stored either.
    """
    robot = _robot(place, robot_name)
    store = None if dry_run else _store(place)
    how = read_map(mapping) if mapping else None
    read, wrong = [], []
    for log in logs:
        try:
            read.append(
                read_recording(log, robot, how=how, dt=dt, split=cast("Split | None", split))
            )
        except FlywheelError as error:
            wrong.append(str(error))
    if wrong:
        others = f"\nNothing was stored of the {len(logs)} logs." if len(logs) > 1 else ""
        raise DataError("\n".join(wrong) + others)
    _refuse_twice(read)
    outcomes = [("not stored (dry run)", "") for _ in read]
    if store is not None:
        outcomes = [_stored(store, one) for one in read]
    if as_json:
        shown = [_as_json(one, *outcome) for one, outcome in zip(read, outcomes, strict=True)]
        typer.echo(json.dumps(shown, indent=1))
        return
    out = console()
    for one, (state, _) in zip(read, outcomes, strict=True):
        _show(out, one, state)
    segments = [segment for _, segment in outcomes if segment]
    if segments:
        _show_setting(out, segments)


def show_stored(place: Path, as_json: bool) -> None:
    """Print the recordings in a store."""
    store = open_store(place)
    rows = []
    for segment, summaries in stored_recordings(store).items():
        for summary, episode in zip(summaries, store.read_segment(segment), strict=True):
            valid = episode.trajectory.observations.valid
            rows.append(
                {
                    "episode": summary.id,
                    "segment": segment,
                    "split": summary.split,
                    "seconds": summary.seconds,
                    "dt": summary.dt,
                    "robot": summary.robot,
                    "points_seen": float(valid.mean()),
                    "conditions": episode.provenance.conditions,
                }
            )
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    out = console()
    if not rows:
        out.print(f"There is no recording in {store.url}.", highlight=False, soft_wrap=True)
        return
    columns = [
        "episode",
        "split",
        "duration [s]",
        "dt [s]",
        "points there [%]",
        "robot",
        "conditions",
    ]
    cells = [
        (
            row["episode"],
            row["split"],
            row["seconds"],
            row["dt"],
            100 * cast("float", row["points_seen"]),
            str(row["robot"])[:12],
            row["conditions"],
        )
        for row in rows
    ]
    out.print(table(f"Recordings in {store.url}", columns, cells))
    _show_setting(out, list(dict.fromkeys(str(row["segment"]) for row in rows)))


def export_episode(place: Path, episode: str, output: Path, robot_name: str | None) -> None:
    """Write an episode as CSV, and say what a CSV has no place for."""
    robot = _robot(place, robot_name)
    found = open_store(place).read(episode)
    left = write_recording(found, output, robot)
    out = console()
    steps = found.trajectory.steps
    out.print(f"{output}: {steps + 1} rows, {steps * found.trajectory.dt:g} s.", highlight=False)
    if left:
        out.print(
            f"A log has no place for: {', '.join(left)}; the CSV does not have it.", highlight=False
        )


def _robot(place: Path, name: str | None) -> Robot:
    """The robot that was named, else that of the run."""
    if name is not None:
        return load_robot(name)
    folder = RunFolder(place)
    if not folder.config_file.exists():
        raise DataError(
            f"{place} is not a run's folder: say with --robot whose episodes these are."
        )
    return folder.robot(folder.config())


def _store(place: Path) -> TrajectoryStore:
    """The store of a run, or the one at a path; a new one where there is nothing."""
    check_folder(place, "store")
    if RunFolder(place).config_file.exists():
        return open_store(place)
    return TrajectoryStore(str(place))


def _refuse_twice(read: Sequence[Imported]) -> None:
    files: dict[str, str] = {}
    for one in read:
        other = files.setdefault(one.report.digest, one.report.file)
        if other != one.report.file:
            raise DataError(f"{other} and {one.report.file} are the same log; name it once.")


def _stored(store: TrajectoryStore, one: Imported) -> tuple[str, str]:
    segment, new = store_recording(store, one)
    return ("stored" if new else f"there already, as {segment}"), segment


def _as_json(one: Imported, state: str, segment: str) -> dict[str, Any]:
    split = one.episodes[0].split
    return {"state": state, "segment": segment, "split": split, **one.report.as_dict()}


def _show(out: Console, one: Imported, state: str) -> None:
    report: ImportReport = one.report
    out.print(
        f"[bold]{report.file}[/bold]: {report.rows} rows, {report.seconds:.4g} s at "
        f"{1 / report.period:.4g} Hz; {100 * report.seen:.4g} % of the points' samples can be used; "
        f"{counted(len(report.episodes), 'episode')} for {one.episodes[0].split}; {state}",
        highlight=False,
        soft_wrap=True,
    )
    if not report.findings:
        out.print("Nothing was masked, repaired or resampled.")
        return
    out.print(
        table(
            f"What was done to {report.file}",
            ["found", "done", "marker or column", "#count", "at [s]", "how"],
            [
                (f.kind, f.action, f.subject or "(all)", f.count, f.when, f.words)
                for f in report.findings
            ],
        )
    )


def _show_setting(out: Console, segments: Sequence[str]) -> None:
    """What makes a run learn from segments."""
    out.print(
        f"A run on this store learns from them with 'collect.recordings=[{','.join(segments)}]'".replace(
            "[", r"\["
        ),
        highlight=False,
        soft_wrap=True,
    )
