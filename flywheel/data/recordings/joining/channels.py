"""Points, winches and cables out of the files of a recording, each with its own times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.data.recordings.joining.bodies import Poses, poses_of
from flywheel.data.recordings.joining.lookup import Found, Sheets, length_of
from flywheel.data.recordings.joining.series import Clock, Series
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.report import Finding, listed
from flywheel.data.recordings.sources import (
    ANGLES,
    FORCES,
    LENGTHS,
    TICKS,
    Channel,
    factor_of,
    newtons_of,
)
from flywheel.data.recordings.tables.columns import channel_names
from flywheel.errors import DataError
from flywheel.records import ChannelKind, Floats
from flywheel.robots import Cable, Robot, Winch

DRUM = (*ANGLES, TICKS)  # units for which a drum's radius is needed


def points_of(
    sheets: Sheets, clocks: Sequence[Clock], robot: Robot, how: RecordingMap
) -> tuple[list[Series | None], list[Finding]]:
    """Positions of each tracked point in our frame; None for those that the map says nobody measured."""
    found: list[Series | None] = []
    missing, notes = [], list[Finding]()
    poses = dict[str, Poses]()
    for body in robot.bodies:
        if body.name in how.poses and any(
            robot.points[i].name not in how.markers for i in body.points
        ):
            poses[body.name], more = poses_of(sheets, clocks, robot, body, how)
            notes += more
    for point in robot.points:
        name = robot.bodies[point.body].name
        if point.name in how.markers:
            marker = how.markers[point.name]
            each = None if marker is None else sheets.needed(marker)
            if each is None:
                words = "nobody measured it, as the map says"
                notes.append(Finding("column", "noted", point.name, 0, words=words))
        elif name in poses:
            each = poses[name].point(point.offset)
        else:
            each = sheets.columns(
                tuple(how.columns.get(f"{point.name}.{a}", f"{point.name}.{a}") for a in "xyz")
            )
            if each is None:
                missing.append(point.name)
        found.append(None if each is None else _series(each, _in_our_frame(each, how), clocks))
    if missing:
        raise _in_no_file(missing, sheets, robot)
    if not any(found):
        raise DataError("the map gives no marker and no pose.")
    return found, notes


def _in_no_file(missing: Sequence[str], sheets: Sheets, robot: Robot) -> DataError:
    """The message about points whose markers are not found."""
    for name in missing:
        if problem := sheets.without_times(name):
            return DataError(problem)
    known = sheets.markers()
    there = f" The files have {listed(known, 12)}." if known else " The files have no marker."
    return DataError(
        f"{listed(missing)} of the robot {robot.name} is in no file: give its marker under markers, the "
        f"pose of its body under poses, or null under markers if nobody measured it.{there}"
    )


def _in_our_frame(found: Found, how: RecordingMap) -> Floats:
    """(N, 3) positions in metres, z up."""
    with np.errstate(over="ignore"):
        return how.axes.turned(found.values * length_of(found.source, how)) + np.array(how.origin)


def positions_of(
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
    return _channel(sheets, clocks, channel, how, "winch", winch)


def cables_of(
    sheets: Sheets, clocks: Sequence[Clock], robot: Robot, how: RecordingMap
) -> dict[tuple[ChannelKind, str], tuple[Series, float | None]]:
    """Measured tensions and lengths of cables with the noise that the map says, by kind and cable.

    Raises:
      DataError: a column is missing, or a cable is not nearly as long as the MJCF says.
    """
    found: dict[tuple[ChannelKind, str], tuple[Series, float | None]] = {}
    cables = {cable.name: cable for cable in robot.cables}
    for name, (kind, cable) in channel_names(robot).items():
        channel: Channel | None = how.lengths.get(cable)
        if kind == "tension":
            channel = how.tensions.get(cable)
        if channel is None:
            name = how.columns.get(name, name)
            if sheets.columns([name]) is None:
                continue
            channel = Channel.model_validate({"from": name})
        found[kind, cable] = (
            _channel(sheets, clocks, channel, how, kind, cables[cable]),
            channel.noise,
        )
    return found


def commands_of(
    sheets: Sheets,
    clocks: Sequence[Clock],
    robot: Robot,
    measured: Sequence[Series | None],
    how: RecordingMap,
) -> list[Series | float]:
    """Commands of each winch, or the constant one that holds it where it was measured."""
    return [
        _told(sheets, clocks, robot, index, measured[index], how)
        for index in range(len(robot.winches))
    ]


def _told(
    sheets: Sheets,
    clocks: Sequence[Clock],
    robot: Robot,
    index: int,
    measured: Series | None,
    how: RecordingMap,
) -> Series | float:
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
    return _channel(sheets, clocks, channel, how, "control", winch)


def _channel(
    sheets: Sheets,
    clocks: Sequence[Clock],
    channel: Channel,
    how: RecordingMap,
    kind: str,
    of: Winch | Cable,
) -> Series:
    """A column in m, m/s or N, with its own times; rows in which it was not written are left out."""
    name = channel.source or ""
    sign = 1.0
    if name.startswith("-") and sheets.columns([name]) is None:
        sign, name = -1.0, name[1:]
    found = sheets.column(name)
    told = "tension" in (kind, of.kind if isinstance(of, Winch) else kind)
    unit = channel.unit or (how.units.tension if told else getattr(how.units, kind))
    drum = channel.drum if channel.drum is not None else how.units.drum
    what = f"the unit of {of.name}"
    _check_unit(channel, unit, kind, of)
    try:
        factor = sign * (
            newtons_of(unit, what) if told else factor_of(unit, what, drum, channel.per)
        )
    except ValueError as error:
        raise DataError(f"{error}.") from None
    values = factor * found.values[:, 0] + channel.add
    made = _series(found, values, clocks, channel.held)
    if kind == "control":
        known = np.isfinite(values)
        if known.sum() < 1 + (not channel.held):
            raise DataError(f"{name!r}, the commands of {of.name}, has {known.sum()} numbers.")
        made = Series(made.time[known], values[known], made.source, channel.held)
    return made


def _check_unit(channel: Channel, unit: str, kind: str, of: Winch | Cable) -> None:
    """Raises DataError for a known unit of another dimension, or for what has no effect with it."""
    base, what = unit.removeprefix("-").removesuffix("/s"), f"the unit of {of.name} is {unit!r}"
    if kind == "control" and channel.noise is not None:
        raise DataError(
            f"the commands of {of.name} have a noise, which has no effect: leave it out."
        )
    if base not in (*LENGTHS, *DRUM, *FORCES):
        return
    rate = kind == "control" and isinstance(of, Winch) and of.kind == "rate"
    if channel.unit and base not in FORCES and rate != unit.endswith("/s"):
        raise DataError(f"{what}, which is {'no' if rate else 'a'} rate; give {base}{'/s' * rate}.")
    for key, given, fitting in (("drum", channel.drum, DRUM), ("per", channel.per, (TICKS,))):
        if given is not None and base not in fitting:
            raise DataError(
                f"{what}, for which {key} has no effect; give unit, one of {', '.join(fitting)} (rates per "
                f"second), or leave {key} out."
            )


def _series(found: Found, values: Floats, clocks: Sequence[Clock], held: bool = False) -> Series:
    """Values of columns at their times.

    Raises:
      DataError: time runs backward.
    """
    time = clocks[found.source.file].of(found.source.time)
    missing = np.flatnonzero(~np.isfinite(time))
    if len(missing):
        raise DataError(f"{found.source.name}: row {found.source.rows[missing[0]]} has no time.")
    backward = np.flatnonzero(np.diff(time) < 0)
    if len(backward):
        at = backward[0]
        episodes = "episode_index" in found.source.stream.columns
        choose = "Choose an episode: where: {episode_index: 0} under files." if episodes else ""
        raise DataError(
            f"{found.source.name}: time runs backward, from {time[at]:.6g} to {time[at + 1]:.6g} s. "
            f"{choose or 'Is it several recordings?'}"
        )
    return Series(time, values, found.source, held)
