"""A recording out of one or several files: its points, commands and winch positions, found by its map."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flywheel.data.recordings.joining.alignment import Aligned
from flywheel.data.recordings.joining.channels import (
    cables_of,
    commands_of,
    points_of,
    positions_of,
)
from flywheel.data.recordings.joining.clocks import Follow, clocks_of
from flywheel.data.recordings.joining.lookup import Sheets
from flywheel.data.recordings.joining.series import one_log
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.report import Finding, listed
from flywheel.data.recordings.sources import FileEntry
from flywheel.data.recordings.tables.columns import Log, check_renamed
from flywheel.errors import DataError
from flywheel.robots import Robot


@dataclass(frozen=True)
class Assembled:
    """A recording as a log.

    Attributes:
      digest: sha256 of the files' digests; of a single file, its own.
      log: as one table.
      period: usual time between two rows with points if others are between [s].
      findings: about the files.
      compared: cables by which clocks were found.
    """

    digest: str
    log: Log
    period: float
    findings: tuple[Finding, ...]
    compared: tuple[Aligned, ...] = ()


def assemble(
    folder: Path,
    entries: Sequence[FileEntry],
    robot: Robot,
    how: RecordingMap,
    dt: float,
    follow: Follow | None = None,
) -> Assembled:
    """Read the files of a recording.

    Args:
      folder: that their paths are relative to.
      entries: at least one.
      robot: of the recording.
      how: where its points and winches are.
      dt: control step of the episodes [s].
      follow: how cables follow winches, for `align: auto`.

    Raises:
      DataError: a file cannot be read, or lacks what the map or the robot needs.
    """
    _check_names(robot, how)
    sheets = Sheets(folder, how, entries)
    findings = [
        Finding("file", "noted", file.name, 0, words=note)
        for file in sheets.files
        for note in file.notes
    ]
    clocks, found, compared = clocks_of(entries, sheets, robot, how, follow)
    findings += found
    points, found = points_of(sheets, clocks, robot, how)
    findings += found
    winches = [positions_of(sheets, clocks, winch, how) for winch in robot.winches]
    commands = commands_of(sheets, clocks, robot, winches, how)
    cables = cables_of(sheets, clocks, robot, how)
    log, period, found = one_log(points, commands, winches, robot, dt, cables)
    findings += found
    digests = [file.digest for file in sheets.files]
    whole = (
        digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
    )
    return Assembled(whole, log, period, tuple(findings), tuple(compared))


def _check_names(robot: Robot, how: RecordingMap) -> None:
    """Raises DataError for names in the map that the robot does not have."""
    check_renamed(robot, how)
    given = {f"{point}.{axis}" for point in how.markers for axis in "xyz"}
    given |= {f"ctrl.{winch}" for winch in how.commands}
    given |= {f"tension.{cable}" for cable in how.tensions} | {f"length.{c}" for c in how.lengths}
    twice = [name for name in how.columns if name in given]
    if twice:
        raise DataError(
            f"the map gives {listed(twice)} twice: under columns, and under markers, commands, tensions or "
            "lengths."
        )
    points, bodies = [p.name for p in robot.points], [b.name for b in robot.bodies]
    winches, cables = [w.name for w in robot.winches], [c.name for c in robot.cables]
    for key, names, known in (
        ("markers", how.markers, points),
        ("poses", how.poses, bodies),
        ("commands", how.commands, winches),
        ("winches", how.winches, winches),
        ("tensions", how.tensions, cables),
        ("lengths", how.lengths, cables),
    ):
        wrong = [name for name in names if name not in known]
        if wrong:
            raise DataError(
                f"the map's {key} has {listed(wrong)}; the robot {robot.name} has {listed(known, 12)}."
            )
    blind = [w.name for w in robot.winches if w.name in how.winches and not w.sensor]
    if blind:
        raise DataError(
            f"the map's winches has {listed(blind)}, whose position the MJCF does not measure: add a "
            f'<user> sensor of its actuator, <user name="{blind[0]}_position" objtype="actuator" '
            f'objname="{blind[0]}" dim="1"/>, or leave it out.'
        )
