"""Mapping of a log's columns to actuators, markers and sensors of the robot; all in SI units, z up."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.report import Finding, counted, listed
from flywheel.data.recordings.tables.table import OpenTable, Table
from flywheel.errors import DataError
from flywheel.records import ChannelKind, Floats, MeasuredChannel
from flywheel.registry import nearest
from flywheel.robots import Robot

TIME = "time"
ARRAYS = ("time", "controls", "points", "winch", "lines")  # of a log


@dataclass(frozen=True)
class Log:
    """Raw values of a log about a robot, row by row.

    Attributes:
      time: (N,) [s].
      controls: (N, W) commands, each acting from its row's time to the next row's.
      points: (N, P, 3) measured [m].
      winch: (N, W) measured winch positions [m].
      lines: (N,) of the file; 0 for rows between those of a slow tracker, which only have commands.
      channels: measured beside the points, (N,) each.
    """

    time: Floats
    controls: Floats
    points: Floats
    winch: Floats
    lines: NDArray[np.int64]
    channels: tuple[MeasuredChannel, ...] = ()

    def __getitem__(self, rows: Any) -> Log:
        """Some of the rows."""
        arrays = {name: getattr(self, name)[rows] for name in ARRAYS}
        return Log(**arrays, channels=tuple(channel[rows] for channel in self.channels))


def finite(values: Floats) -> Floats:
    """The values, with NaN in the place of infinite ones."""
    return np.where(np.isfinite(values), values, np.nan)


def control_names(robot: Robot) -> list[str]:
    """Our names of the columns of commands, one per winch."""
    return [f"ctrl.{winch.name}" for winch in robot.winches]


def point_names(robot: Robot) -> list[str]:
    """Our names of the columns of points, three per tracked point."""
    return [f"{point.name}.{axis}" for point in robot.points for axis in "xyz"]


def winch_names(robot: Robot) -> dict[str, int]:
    """Our names of the columns of winch positions -> index of the winch."""
    return {winch.sensor: i for i, winch in enumerate(robot.winches) if winch.sensor}


def channel_names(robot: Robot) -> dict[str, tuple[ChannelKind, str]]:
    """Our names of the columns of tensions and lengths -> kind and cable, for all cables."""
    kinds: tuple[ChannelKind, ...] = ("tension", "length")
    others = {TIME, *control_names(robot), *point_names(robot), *winch_names(robot)}
    names = {f"{kind}.{cable.name}": (kind, cable.name) for kind in kinds for cable in robot.cables}
    return {name: key for name, key in names.items() if name not in others}


def _names(robot: Robot) -> list[str]:
    """Our names of all columns that a log may have."""
    points = [*control_names(robot), *point_names(robot)]
    return [TIME, *points, *winch_names(robot), *channel_names(robot)]


def check_renamed(robot: Robot, how: RecordingMap) -> None:
    """Raises DataError for a column that a map renames, and the robot does not have."""
    known = _names(robot)
    for name in how.columns:
        if name not in known:
            raise DataError(
                f"the map renames {name!r}, which the robot {robot.name} does not "
                f"have.{nearest(name, known)}"
            )


@dataclass(frozen=True)
class Columns:
    """Selection of a file's columns.

    Attributes:
      theirs: our name -> the file's, for existing ones.
      ignored: names of columns ignored by the map.
    """

    theirs: dict[str, str]
    ignored: tuple[str, ...]


def matched(
    sheet: OpenTable, robot: Robot, how: RecordingMap, commands_only: bool = False
) -> Columns:
    """Find the robot's columns by their names.

    Args:
      sheet: file with the header.
      robot: of the log.
      how: names that differ, and unused columns.
      commands_only: the measurements are optional, and not read.

    Raises:
      DataError: a column is missing, or an unknown one exists.
    """
    needed = control_names(robot) if commands_only else [*control_names(robot), *point_names(robot)]
    known = _names(robot)
    check_renamed(robot, how)
    theirs = _their_names(sheet, how, known)
    _refuse_unknown(sheet, robot, how, theirs)
    there = set(sheet.header)
    missing = [theirs[name] for name in needed if theirs[name] not in there]
    if missing:
        unused = [name for name in how.columns if theirs[name] in missing]
        hint = f" The map renames {listed(unused)}." if unused else ""
        raise DataError(
            f"{sheet.file} lacks {counted(len(missing), 'column')} of the robot {robot.name}: "
            f"{listed(missing)}.{hint}"
        )
    _check_times(sheet, theirs[TIME], how)
    wanted, ignored = [TIME, *needed] if commands_only else known, set(how.ignore)
    return Columns(
        {name: theirs[name] for name in wanted if theirs[name] in there},
        tuple(name for name in sheet.header if name in ignored),
    )


def pick(
    table: Table, columns: Columns, robot: Robot, how: RecordingMap
) -> tuple[Log, list[Finding]]:
    """The robot's columns of a table, in SI units and our axes, and findings about the others."""
    rows, theirs = len(table.values), columns.theirs
    findings = [
        Finding("column", "left out", name, rows, words="ignored, as the map says")
        for name in columns.ignored
    ]

    def raw(names: list[str]) -> Floats:
        return table.columns([theirs[name] for name in names])

    def values(names: list[str], unit: str) -> Floats:
        found = raw(names)
        found *= how.units.factor(unit)
        return found

    tension = "tension" if robot.tension_driven else ""
    with np.errstate(over="ignore"):  # infinite values are looked for next
        if TIME in theirs:
            time = values([TIME], "time")[:, 0]
        else:
            time = cast("float", how.dt) * np.arange(rows)
        points = raw([name for name in point_names(robot) if name in theirs])
        points = points.reshape(rows, points.shape[1] // 3, 3)
        points *= how.units.metres
        points = how.axes.turned(points)
        points += how.origin
        winch = np.full((rows, len(robot.winches)), np.nan)
        for name, index in winch_names(robot).items():
            if name in theirs:
                winch[:, index] = values([name], tension or "winch")[:, 0]
            else:
                words = "the log has no such column; winch positions are dead-reckoned"
                findings.append(Finding("channel", "noted", name, 0, words=words))
        controls = values(control_names(robot), tension or "control")
        channels = tuple(
            MeasuredChannel(*key, finite(values([name], key[0])[:, 0]))
            for name, key in channel_names(robot).items()
            if name in theirs
        )
        log = Log(time, controls, points, winch, table.lines, channels)
    return log, findings


def _their_names(sheet: OpenTable, how: RecordingMap, known: list[str]) -> dict[str, str]:
    """Our name -> the file's name, of every allowed column."""
    theirs = {name: how.columns.get(name, name) for name in known}
    twice = [name for name, n in Counter(theirs.values()).items() if n > 1]
    if twice:
        raise DataError(f"{sheet.file}: the map takes {listed(twice)} for more than one column.")
    return theirs


def _refuse_unknown(
    sheet: OpenTable, robot: Robot, how: RecordingMap, theirs: dict[str, str]
) -> None:
    there, used, ignored = set(sheet.header), set(theirs.values()), set(how.ignore)
    gone = [name for name in how.ignore if name not in there]
    if gone:
        raise DataError(
            f"{sheet.file} has no column {listed(gone)} to ignore.{nearest(gone[0], sheet.header)}"
        )
    both = [name for name in theirs.values() if name in ignored]
    if both:
        raise DataError(f"{sheet.file}: the map ignores {listed(both)}, which the robot needs.")
    known = used | ignored
    unknown = [name for name in sheet.header if name and name not in known]
    if not unknown:
        return
    wanted = [name for name in theirs.values() if name not in there]
    others = ""
    if len(unknown) > len(sheet.header) / 2:
        others = " Is it a recording of another robot?"
    raise DataError(
        f"{sheet.file} has {counted(len(unknown), 'column')} that the robot {robot.name} does not have: "
        f"{listed(unknown)}.{nearest(unknown[0], wanted)}{others} Rename them in the map (columns: "
        "{ours: theirs}) or name them under ignore."
    )


def _check_times(sheet: OpenTable, name: str, how: RecordingMap) -> None:
    if name in sheet.header and how.dt is not None:
        raise DataError(
            f"{sheet.file} has a time column {name!r}, and the map gives dt too; keep one (name "
            "the column under columns: {time: ...}, or under ignore and columns: {time: none})."
        )
    if name not in sheet.header and how.dt is None:
        raise DataError(
            f"{sheet.file} has no column 'time'. Name it in the map (columns: {{time: ...}}), or give "
            "dt [s] there if rows are evenly spaced."
        )
