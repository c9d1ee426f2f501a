"""A recording out of one or several files: its points, commands and winch positions, found by its map."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flywheel.data.recordings.bodies import pose_points
from flywheel.data.recordings.columns import Log
from flywheel.data.recordings.lookup import Found, Sheets, length_of
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.report import Finding, listed
from flywheel.data.recordings.series import Clock, Series, one_log
from flywheel.data.recordings.sources import Channel, FileEntry, factor_of
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot, Winch


@dataclass(frozen=True)
class Assembled:
    """A recording as a log.

    Attributes:
      digest: sha256 of the files' digests; of a single file, its own.
      log: as one table.
      period: usual time between two rows with points [s].
      findings: about the files.
    """

    digest: str
    log: Log
    period: float
    findings: tuple[Finding, ...]


def assemble(
    folder: Path, entries: Sequence[FileEntry], robot: Robot, how: RecordingMap, dt: float
) -> Assembled:
    """Read the files of a recording.

    Args:
      folder: that their paths are relative to.
      entries: at least one.
      robot: of the recording.
      how: where its points and winches are.
      dt: control step of the episodes [s].

    Raises:
      DataError: a file cannot be read, or lacks what the map or the robot needs.
    """
    _check_names(robot, how)
    sheets = Sheets(folder, how, entries)
    clocks = [Clock(entry.offset, entry.pace) for entry in entries]
    findings = [
        Finding("file", "noted", file.name, 0, words=note)
        for file in sheets.files
        for note in file.notes
    ]
    points, found = _points(sheets, clocks, robot, how)
    findings += found
    winches = [_positions(sheets, clocks, winch, how) for winch in robot.winches]
    commands = [
        _commands(sheets, clocks, robot, i, winches[i], how) for i in range(len(robot.winches))
    ]
    log, period, found = one_log(points, commands, winches, robot, dt)
    findings += found
    digests = [file.digest for file in sheets.files]
    whole = (
        digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
    )
    return Assembled(whole, log, period, tuple(findings))


def _check_names(robot: Robot, how: RecordingMap) -> None:
    """Raises DataError for names in the map that the robot does not have."""
    points, bodies = [p.name for p in robot.points], [b.name for b in robot.bodies]
    winches = [w.name for w in robot.winches]
    for key, names, known in (
        ("markers", how.markers, points),
        ("poses", how.poses, bodies),
        ("commands", how.commands, winches),
        ("winches", how.winches, winches),
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
            "<user> sensor of its actuator, or leave it out."
        )


def _points(
    sheets: Sheets, clocks: Sequence[Clock], robot: Robot, how: RecordingMap
) -> tuple[list[Series | None], list[Finding]]:
    """Positions of each tracked point in our frame; None for those that the map says nobody measured."""
    found: list[Series | None] = []
    missing, notes = [], []
    for point in robot.points:
        body = robot.bodies[point.body].name
        if point.name in how.markers:
            name = how.markers[point.name]
            each = None if name is None else sheets.needed(name)
            if each is None:
                notes.append(
                    Finding(
                        "column",
                        "noted",
                        point.name,
                        0,
                        words="nobody measured it, as the map says",
                    )
                )
        elif body in how.poses:
            each = pose_points(sheets, body, point.offset, how)
        else:
            each = sheets.columns(
                tuple(how.columns.get(f"{point.name}.{a}", f"{point.name}.{a}") for a in "xyz")
            )
            if each is None:
                missing.append(point.name)
        found.append(None if each is None else _series(each, _in_our_frame(each, how), clocks))
    if missing:
        known = sheets.markers()
        there = f" The files have {listed(known, 12)}." if known else " The files have no marker."
        raise DataError(
            f"{listed(missing)} of the robot {robot.name} is in no file: give its marker under markers, the "
            f"pose of its body under poses, or null under markers if nobody measured it.{there}"
        )
    if not any(found):
        raise DataError("the map gives no marker and no pose.")
    return found, notes


def _in_our_frame(found: Found, how: RecordingMap) -> Floats:
    """(N, 3) positions in metres, z up."""
    with np.errstate(over="ignore"):
        return how.axes.turned(found.values * length_of(found.source, how)) + np.array(how.origin)


def _series(found: Found, values: Floats, clocks: Sequence[Clock], held: bool = False) -> Series:
    return Series(clocks[found.source.file].of(found.source.time), values, found.source, held)


def _positions(
    sheets: Sheets, clocks: Sequence[Clock], winch: Winch, how: RecordingMap
) -> Series | None:
    """Measured positions of a winch; None without a column."""
    channel = how.winches.get(winch.name)
    if channel is None and winch.sensor:
        name = how.columns.get(winch.sensor, winch.sensor)
        if sheets.columns([name]) is None:
            return None
        channel = Channel.model_validate({"from": name})
    if channel is None or channel.hold:
        return None
    return _channel(sheets, clocks, channel, how, "winch", winch.name)


def _commands(
    sheets: Sheets,
    clocks: Sequence[Clock],
    robot: Robot,
    index: int,
    measured: Series | None,
    how: RecordingMap,
) -> Series | float:
    """Commands of a winch, or the constant one that holds it."""
    winch = robot.winches[index]
    channel = how.commands.get(winch.name)
    if channel is None:
        name = how.columns.get(f"ctrl.{winch.name}", f"ctrl.{winch.name}")
        if sheets.columns([name]) is None:
            raise DataError(
                f"the winch {winch.name} has no commands: give its column under commands "
                f"({winch.name}: COLUMN), or {winch.name}: hold if it never moved. There are: "
                f"{listed([repr(n) for n in sheets.names()], 12)}."
            )
        channel = Channel.model_validate({"from": name})
    if channel.hold:
        at = robot.winch_of(robot.keyframe)[index]
        if measured is not None and np.isfinite(measured.values).any():
            at = np.nanmedian(measured.values)
        return float(robot.holding(np.full(len(robot.winches), at))[index])
    return _channel(sheets, clocks, channel, how, "control", winch.name)


def _channel(
    sheets: Sheets,
    clocks: Sequence[Clock],
    channel: Channel,
    how: RecordingMap,
    kind: str,
    winch: str,
) -> Series:
    """A column in m or m/s, with its own times; rows in which it was not written are left out."""
    name = channel.source or ""
    sign = 1.0
    if name.startswith("-") and sheets.columns([name]) is None:
        sign, name = -1.0, name[1:]
    found = sheets.column(name)
    unit = channel.unit or getattr(how.units, kind)
    drum = channel.drum if channel.drum is not None else how.units.drum
    try:
        factor = sign * factor_of(unit, f"the unit of {winch}", drum, channel.per)
    except ValueError as error:
        raise DataError(f"{error}.") from None
    values = factor * found.values[:, 0] + channel.add
    made = _series(found, values, clocks, channel.held)
    if kind == "control":
        known = np.isfinite(values)
        if known.sum() < 1 + (not channel.held):
            raise DataError(f"{name!r}, the commands of {winch}, has {known.sum()} numbers.")
        made = Series(made.time[known], values[known], made.source, channel.held)
    backward = np.flatnonzero(np.diff(made.time) < 0)
    if len(backward):
        at = backward[0]
        episodes = "episode_index" in found.source.stream.columns
        raise DataError(
            f"{found.source.name}: time runs backward, from {made.time[at]:.6g} to "
            f"{made.time[at + 1]:.6g} s. "
            + (
                "Choose an episode: where: {episode_index: 0} under files."
                if episodes
                else "Is it several recordings?"
            )
        )
    return made
