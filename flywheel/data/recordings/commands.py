"""Command scripts as CSV files: logs whose only columns are the time and the commands."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from flywheel.data.recordings.clock import stretches, usual_period, without_duplicates
from flywheel.data.recordings.columns import (
    TIME,
    Log,
    control_names,
    pick,
    point_names,
    without_infinities,
)
from flywheel.data.recordings.geometry import check_commands
from flywheel.data.recordings.grid import on_grid
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.reading import beside
from flywheel.data.recordings.table import Table, read_table
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot


def read_commands(path: str | Path, robot: Robot, dt: float = 0.01) -> Floats:
    """Commands (T, W) of a script, or of a recording, whose points are not looked at.

    Row t holds the commands that act until the next row's time; those of the last row act on nothing
    and may be empty. A YAML of the same name says what other names and units mean.

    Args:
      path: of the CSV.
      robot: whose winches are commanded.
      dt: control step wanted [s].

    Raises:
      DataError: not a script of this robot; the message says where and why.
      ConfigError: the YAML beside it is wrong.
    """
    if not dt > 0:
        raise DataError(f"dt must be positive seconds, got {dt!r}.")
    path = Path(path)
    how = beside(path)
    table = _without_points(read_table(path), robot, how)
    log, _ = pick(table, robot, how)
    try:
        return _commands(log, robot, how, dt)
    except DataError as error:
        raise DataError(f"{path.name}: {error}") from None


def write_commands(controls: Floats, dt: float, path: str | Path, robot: Robot) -> Path:
    """Write commands (T, W), each for dt [s], as `read_commands` reads them back.

    Raises:
      DataError: there is a file already, or it cannot be written.
    """
    time = np.round(dt * np.arange(len(controls) + 1), 9)
    try:
        with Path(path).open("x", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([TIME, *control_names(robot)])
            for now, row in zip(time, controls, strict=False):
                writer.writerow([repr(float(now)), *(repr(float(value)) for value in row)])
            writer.writerow([repr(float(time[-1])), *[""] * controls.shape[1]])
    except FileExistsError:
        raise DataError(f"There is a file {path} already; it is not written over.") from None
    except OSError as error:
        raise DataError(f"{path} cannot be written: {error.strerror}.") from None
    return Path(path)


def _without_points(table: Table, robot: Robot, how: RecordingMap) -> Table:
    """The table with every column of points there, and nothing in it."""
    names = {how.columns.get(name, name) for name in point_names(robot)}
    kept = [i for i, name in enumerate(table.header) if name not in names]
    empty = np.full((len(table.values), len(names)), np.nan)
    header = (*(table.header[i] for i in kept), *sorted(names))
    return replace(
        table, header=header, values=np.concatenate([table.values[:, kept], empty], axis=1)
    )


def _commands(log: Log, robot: Robot, how: RecordingMap, dt: float) -> Floats:
    log, _ = without_infinities(log, robot)
    log, _ = without_duplicates(log)
    if len(log.time) < 2:
        raise DataError("all rows have one time; a script needs at least 2.")
    period = usual_period(log)
    check_commands(log, robot)
    parts, _ = stretches(log, period)
    if len(parts) > 1:
        raise DataError(
            f"a gap: nothing is commanded from {parts[0].time[-1]:.6g} to {parts[1].time[0]:.6g} s. Rows "
            f"are {period:.4g} s apart; a script has one for every step, also where nothing changes."
        )
    track, _ = on_grid(log, period, dt, how.jitter)
    return np.asarray(np.clip(track.controls, robot.control_low, robot.control_high))
