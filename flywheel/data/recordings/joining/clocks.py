"""The clocks of a recording's files: given by the map, or found from the points and the winches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, log10

import numpy as np

from flywheel.data.recordings.grid import held
from flywheel.data.recordings.joining.alignment import (
    MOST_SECONDS,
    SHORTEST,
    Aligned,
    Mover,
    align,
    seen_lengths,
)
from flywheel.data.recordings.joining.channels import commands_of, points_of, positions_of
from flywheel.data.recordings.joining.lookup import Sheets
from flywheel.data.recordings.joining.series import Clock, Series
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.report import Finding, counted
from flywheel.data.recordings.sources import FileEntry
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot

STEP = 0.01  # [s] in which the winches' positions are followed
ROUNDS = 3  # in which also the positions are found from which the winches begin
UNKNOWN = 1.0  # [s] after which nothing is left of how a robot moved before

# Lengths (n, cables) [m] of a robot whose winches are at positions (n, W) [m], in steps of so many seconds.
Follow = Callable[[Robot, Floats, float], Floats]


def clocks_of(
    entries: Sequence[FileEntry],
    sheets: Sheets,
    robot: Robot,
    how: RecordingMap,
    follow: Follow | None,
) -> tuple[list[Clock], list[Finding], list[Aligned]]:
    """The clock of each file by the first one's; of those that were found, findings and the cables compared.

    Args:
      entries: of the map.
      sheets: the files.
      robot: of the recording.
      how: the map.
      follow: how cables follow winches; without it they are taken to follow at once.

    Raises:
      DataError: a clock cannot be found.
    """
    clocks = [Clock(entry.offset, entry.pace) for entry in entries]
    wanted = [i for i, entry in enumerate(entries) if entry.align]
    if not wanted:
        return clocks, [], []
    if robot.tension_driven:
        raise DataError(
            "align: auto compares cables with rest lengths, and this robot's winches take tensions: give "
            "offset."
        )
    own = [Clock(0.0, 1.0)] * len(entries)
    points, _ = points_of(sheets, own, robot, how)
    if (
        None in points
        or any(each is not None and each.source.file for each in points)
        or 0 in wanted
    ):
        raise DataError(
            "align: auto needs all points in the first file, and is of the others: else give offset."
        )
    findings, compared = [], list[Aligned]()
    for index in wanted:
        clocks[index], words, cables = _between(index, sheets, points, robot, how, follow)
        findings.append(Finding("clock", "aligned", sheets.files[index].name, 0, words=words))
        compared += cables
    return clocks, findings, compared


def _between(
    file: int,
    sheets: Sheets,
    points: Sequence[Series | None],
    robot: Robot,
    how: RecordingMap,
    follow: Follow | None,
) -> tuple[Clock, str, list[Aligned]]:
    """The clock of a file with winches by that of the points, words about it, and the cables compared."""
    time, positions, moving = _positions(file, sheets, robot, how)
    known = [each for each in points if each is not None]
    stacked = np.stack([each.values for each in known], axis=1)
    firsts = [robot.winches[i].cables[0] for i in moving]
    for _ in range(ROUNDS if follow else 1):
        cables = _followed(robot, positions) if follow is None else follow(robot, positions, STEP)
        # How it moved at the beginning is unknown.
        later = round(UNKNOWN / STEP) if time[-1] - time[0] > 5 * UNKNOWN else 0
        movers = [Mover(cable, time[later:], cables[later:, cable]) for cable in firsts]
        found = align(known[0].time, stacked, movers, robot)
        positions[:, moving] -= found.longer  # where the winches began
    sure = "" if follow else " and what the cables take to follow"
    lengths, file_name = seen_lengths(stacked, robot), sheets.files[file].name
    compared = [
        Aligned(
            file_name,
            robot.cables[each.cable].name,
            found.clock,
            known[0].time,
            lengths[:, each.cable],
            found.clock.offset + found.clock.pace * each.time,
            each.made - longer,
        )
        for each, longer in zip(movers, found.longer, strict=True)
    ]
    far = max(abs(time[0]), abs(time[-1]), 100.0)
    # A pace with these is as exact as the offset, also of stamps since 1970.
    digits = 4 + ceil(log10(far))
    words = (
        f"its time 0 is {found.clock.offset:.4f} s of {sheets.files[0].name}, its second "
        f"{found.clock.pace:.{digits}f} s, within {1e3 * found.sd:.2g} ms{sure}; "
        f"{counted(len(moving), 'cable')} compared, usually off by {1e3 * found.residual:.3g} mm"
    )
    return found.clock, words, compared


def _followed(robot: Robot, positions: Floats) -> Floats:
    """Lengths (n, C) of cables that follow winches at positions (n, W) at once [m]."""
    cables = np.zeros((len(positions), len(robot.cables)))
    for i, winch in enumerate(robot.winches):
        cables[:, winch.cables] = positions[:, [i]] * winch.ratios
    return cables


def _positions(
    file: int, sheets: Sheets, robot: Robot, how: RecordingMap
) -> tuple[Floats, Floats, list[int]]:
    """Regular times (n,) by a file's own clock [s], positions (n, W) [m], and the winches that it tells."""
    own = [Clock(0.0, 1.0)] * len(sheets.files)
    measured = [positions_of(sheets, own, winch, how) for winch in robot.winches]
    told = commands_of(sheets, own, robot, measured, how)
    here = [
        [each if isinstance(each, Series) and each.source.file == file else None for each in some]
        for some in (measured, told)
    ]
    series = [each for some in here for each in some if each is not None]
    if not series:
        raise DataError(
            f"align: auto needs commands or positions of winches in {sheets.files[file].name}: give offset."
        )
    begin, end = max(s.time[0] for s in series), min(s.time[-1] for s in series)
    if not SHORTEST <= end - begin <= MOST_SECONDS:
        raise DataError(
            f"align: auto needs winches over {SHORTEST:g} to {MOST_SECONDS:g} s; {sheets.files[file].name} "
            f"has {end - begin:.6g} s. Is the unit of its times right?"
        )
    time = np.arange(begin, end, STEP)
    keyframe = robot.winch_of(robot.keyframe)
    controls = np.tile(robot.holding(keyframe), (len(time) - 1, 1))
    known = np.full((len(time), len(robot.winches)), np.nan)
    for i, (position, command) in enumerate(zip(*here, strict=True)):
        if command is not None:
            last = np.append(command.time, command.time[-1] + 1.0)
            values = np.append(command.values, 0.0)[:, None]
            controls[:, i] = held(last, values, time)[:, 0]
        if position is not None and np.isfinite(position.values).sum() > 1:
            there = np.isfinite(position.values)
            known[:, i] = np.interp(time, position.time[there], position.values[there])
    start = np.where(np.isfinite(known[0]), known[0], keyframe)
    positions = robot.dead_reckon(start, controls, STEP, known)
    moving = [
        i for i in range(len(robot.winches)) if here[0][i] is not None or here[1][i] is not None
    ]
    return time, positions, moving
