"""Which column of a log is which actuator, marker or sensor of the robot; all in SI units, z up."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.report import Finding, counted, listed
from flywheel.data.recordings.table import Table
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot

TIME = "time"


@dataclass(frozen=True)
class Log:
    """What a log says of a robot, row by row, as it came.

    Attributes:
      time: (N,) [s].
      controls: (N, W) commands, each acting from its row's time to the next row's.
      points: (N, P, 3) measured [m].
      winch: (N, W) measured winch positions [m].
      lines: (N,) of the file.
    """

    time: Floats
    controls: Floats
    points: Floats
    winch: Floats
    lines: NDArray[np.int64]

    def __getitem__(self, rows: Any) -> Log:
        """Some of the rows."""
        return Log(
            self.time[rows],
            self.controls[rows],
            self.points[rows],
            self.winch[rows],
            self.lines[rows],
        )


def control_names(robot: Robot) -> list[str]:
    """Our names of the columns of commands, one per winch."""
    return [f"ctrl.{winch.name}" for winch in robot.winches]


def point_names(robot: Robot) -> list[str]:
    """Our names of the columns of points, three per tracked point."""
    return [f"{point.name}.{axis}" for point in robot.points for axis in "xyz"]


def winch_names(robot: Robot) -> dict[str, int]:
    """Our names of the columns of winch positions -> index of the winch."""
    return {winch.sensor: i for i, winch in enumerate(robot.winches) if winch.sensor}


def pick(table: Table, robot: Robot, how: RecordingMap) -> tuple[Log, list[Finding]]:
    """The robot's columns of a table, and what was said about the others.

    Raises:
      DataError: a column is missing, or one is there that nobody knows.
    """
    theirs = _their_names(table, robot, how)
    findings = [
        Finding("column", "left out", name, len(table.values), words="ignored, as the map says")
        for name in table.header
        if name in how.ignore
    ]

    def columns(names: list[str]) -> Floats:
        return np.stack([table.column(theirs[name]) for name in names], axis=1)

    rows = len(table.values)
    points = columns(point_names(robot)).reshape(rows, -1, 3) * how.units.factor("points")
    winch = np.full((rows, len(robot.winches)), np.nan)
    for name, index in winch_names(robot).items():
        if name in theirs:
            winch[:, index] = table.column(theirs[name]) * how.units.factor("winch")
        else:
            words = "the log has no such column; winch positions are dead-reckoned"
            findings.append(Finding("channel", "noted", name, 0, words=words))
    log = Log(
        time=_times(table, theirs, how),
        controls=columns(control_names(robot)) * how.units.factor("control"),
        points=how.axes.turned(points) + how.origin,
        winch=winch,
        lines=table.lines,
    )
    return log, findings


def without_infinities(log: Log, robot: Robot) -> tuple[Log, list[Finding]]:
    """Infinite measurements are masked, and missing ones counted. A marker is seen as a whole.

    Raises:
      DataError: a command or a time is not a finite number; only the last row's commands may be
        empty, because they act on nothing.
    """
    for what, values, least in (("time", log.time[:, None], 0), ("command", log.controls, 1)):
        used = values[: len(values) - least]
        wrong = np.argwhere(~np.isfinite(used))
        if len(wrong):
            row, column = wrong[0]
            name = TIME if what == "time" else control_names(robot)[column]
            raise DataError(
                f"line {log.lines[row]}: the {what} in {name!r} is {_shown(values[row, column])}, in "
                f"{counted(len(wrong), 'place')} in all. Times and commands must be finite numbers; only the "
                "last row's commands may be empty."
            )
    findings = []
    points, winch = log.points.copy(), log.winch.copy()
    for index, point in enumerate(robot.points):
        infinite = np.asarray(np.isinf(points[:, index]).any(axis=-1))
        missing = np.asarray(np.isnan(points[:, index]).any(axis=-1)) & ~infinite
        points[infinite | missing, index] = np.nan
        for kind, where in (("infinite", infinite), ("missing", missing)):
            if where.any():
                findings.append(Finding.over(kind, "masked", point.name, where, log.time))
    for name, index in winch_names(robot).items():
        infinite = np.isinf(winch[:, index])
        winch[infinite, index] = np.nan
        if infinite.any():
            findings.append(Finding.over("infinite", "masked", name, infinite, log.time))
        missing = np.isnan(winch[:, index]) & ~infinite
        if missing.any() and not missing.all():
            findings.append(Finding.over("missing", "masked", name, missing, log.time))
    return replace(log, points=points, winch=winch), findings


def _their_names(table: Table, robot: Robot, how: RecordingMap) -> dict[str, str]:
    """Our name -> the table's name, of every column that is there."""
    needed = [*control_names(robot), *point_names(robot)]
    known = [TIME, *needed, *winch_names(robot)]
    for name in how.columns:
        if name not in known:
            raise DataError(
                f"{table.file}: the map renames {name!r}, which the robot {robot.name} does not "
                f"have.{_near(name, known)}"
            )
    theirs = {name: how.columns.get(name, name) for name in known}
    twice = [name for name, n in Counter(theirs.values()).items() if n > 1]
    if twice:
        raise DataError(f"{table.file}: the map takes {listed(twice)} for more than one column.")
    _refuse_unknown(table, robot, how, theirs)
    missing = [theirs[name] for name in needed if theirs[name] not in table.header]
    if missing:
        unused = [name for name in how.columns if theirs[name] in missing]
        hint = f" The map renames {listed(unused)}." if unused else ""
        raise DataError(
            f"{table.file} lacks {counted(len(missing), 'column')} of the robot {robot.name}: "
            f"{listed(missing)}.{hint}"
        )
    return {ours: name for ours, name in theirs.items() if name in table.header}


def _refuse_unknown(table: Table, robot: Robot, how: RecordingMap, theirs: dict[str, str]) -> None:
    gone = [name for name in how.ignore if name not in table.header]
    if gone:
        raise DataError(
            f"{table.file} has no column {listed(gone)} to ignore.{_near(gone[0], table.header)}"
        )
    used = [name for name in theirs.values() if name in how.ignore]
    if used:
        raise DataError(f"{table.file}: the map ignores {listed(used)}, which the robot needs.")
    unknown = [n for n in table.header if n not in theirs.values() and n not in how.ignore]
    if not unknown:
        return
    wanted = [name for name in theirs.values() if name not in table.header]
    others = ""
    if len(unknown) > len(table.header) / 2:
        others = " Is it a recording of another robot?"
    raise DataError(
        f"{table.file} has {counted(len(unknown), 'column')} that the robot {robot.name} does not have: "
        f"{listed(unknown)}.{_near(unknown[0], wanted)}{others} Rename them in the map (columns: "
        "{ours: theirs}) or name them under ignore."
    )


def _times(table: Table, theirs: dict[str, str], how: RecordingMap) -> Floats:
    if TIME in theirs and how.dt is None:
        return table.column(theirs[TIME]) * how.units.factor("time")
    if TIME in theirs:
        raise DataError(
            f"{table.file} has a time column {theirs[TIME]!r}, and the map gives dt too; keep one (name "
            "the column under columns: {time: ...}, or under ignore and columns: {time: none})."
        )
    if how.dt is None:
        raise DataError(
            f"{table.file} has no column 'time'. Name it in the map (columns: {{time: ...}}), or give "
            "dt [s] there if rows are evenly spaced."
        )
    return how.dt * np.arange(len(table.values))


def _near(name: str, known: Any) -> str:
    found = get_close_matches(name, list(known), n=1)
    return f" Did you mean {found[0]!r}?" if found else ""


def _shown(value: float) -> str:
    return "missing" if np.isnan(value) else f"{value:g}"
