"""Impossible values: missing, infinite, or too large for computations."""

from __future__ import annotations

import numpy as np

from flywheel.data.recordings.report import Finding, counted
from flywheel.data.recordings.tables.columns import TIME, Log, control_names, winch_names
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot

LATEST = 1e11  # [s]: 3000 years after 1970; beyond, stamps are too coarse for a control step
FARTHEST = 1e6  # robot lengths from the origin: anything further away is no position
OFTEN_FAR = 0.1  # share of such samples from which the log is in another unit


def check_commanded(log: Log, robot: Robot) -> None:
    """Check times and commands, without which a row is meaningless.

    Raises:
      DataError: one is not a finite number (only the last row's commands may be empty, because they
        have no effect), or a time is too late.
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
    late = np.flatnonzero(np.abs(log.time) > LATEST)
    if len(late):
        raise DataError(
            f"line {log.lines[late[0]]}: the time is {log.time[late[0]]:g} s, at most {LATEST:g} s are "
            "possible. If it is not in seconds, say so in the map: units: {time: ms}, us or ns."
        )


def mask_impossible(log: Log, robot: Robot) -> list[Finding]:
    """Mask, in place, measurements that are missing, infinite or too far away; markers as a whole.

    Raises:
      DataError: many are too far away.
    """
    markers = [
        found
        for index, point in enumerate(robot.points)
        for found in _masked(log.points[:, index], point.name, log, robot)
    ]
    _check_near(markers, log.points, robot)
    findings = markers
    for name, index in winch_names(robot).items():
        values = log.winch[:, index, None]
        if not np.isnan(values).all():  # else there is no such column
            found = _masked(values, name, log, robot)
            _check_near(found, values, robot)
            findings = findings + found
    return findings


def _masked(values: Floats, name: str, log: Log, robot: Robot) -> list[Finding]:
    """Mask the impossible rows of values (N, axes); rows of no file miss nothing."""
    infinite = np.asarray(np.isinf(values).any(axis=1))
    missing = np.isnan(values).any(axis=1) & ~infinite
    far = (np.abs(values) > FARTHEST * robot.length).any(axis=1) & ~infinite & ~missing
    values[infinite | missing | far] = np.nan
    return [
        Finding.over(kind, "masked", name, where, log.time, words)
        for kind, where, words in (
            ("infinite", infinite, ""),
            ("missing", missing & (log.lines > 0), ""),
            ("far", far, f"more than {FARTHEST:g} lengths of the robot away: not a position"),
        )
        if where.any()
    ]


def _check_near(findings: list[Finding], values: Floats, robot: Robot) -> None:
    """Raises DataError if many of the values, by now masked, were too far away."""
    far = [found for found in findings if found.kind == "far"]
    count = sum(found.count for found in far)
    seen = count + np.count_nonzero(np.isfinite(values[..., 0]))
    if count > OFTEN_FAR * seen:
        raise DataError(
            f"{count / seen:.0%} of the positions are more than {FARTHEST * robot.length:.3g} m away "
            f"({FARTHEST:g} times the robot's length), first of {far[0].subject!r} at "
            f"{far[0].spans[0][0]:g} s. Are these its positions, and is their unit right?"
        )


def _shown(value: float) -> str:
    return "missing" if np.isnan(value) else f"{value:g}"
