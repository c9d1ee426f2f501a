"""Command scripts as CSV files: logs whose only columns are the time and the commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flywheel.data.recordings.clock import stretches, usual_period, without_duplicates
from flywheel.data.recordings.geometry import check_commands
from flywheel.data.recordings.grid import check_steps, most_rows, on_grid
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.reading import beside
from flywheel.data.recordings.tables.columns import TIME, Log, control_names, matched, pick
from flywheel.data.recordings.tables.table import open_table
from flywheel.data.recordings.tables.values import check_commanded
from flywheel.data.recordings.writing import new_csv
from flywheel.errors import DataError
from flywheel.outputs import printable
from flywheel.quantities import CONTROL_STEP
from flywheel.records import Floats
from flywheel.robots import Robot


def read_commands(path: str | Path, robot: Robot, dt: float = 0.01) -> Floats:
    """Commands (T, W) of a script, or of a recording without its points.

    Row t contains the commands until the next row's time; those of the last row have no effect and
    may be empty. A YAML of the same name defines other names and units.

    Args:
      path: of the CSV.
      robot: commanded robot.
      dt: desired control step [s].

    Raises:
      DataError: not a script of this robot; the message says where and why.
      ConfigError: the YAML next to it is wrong.
    """
    CONTROL_STEP.check(dt, "A control step, dt,", DataError)
    path = Path(path)
    with open_table(path) as sheet:
        how = beside(path)
        columns = matched(sheet, robot, how, commands_only=True)
        table = sheet.read(list(columns.theirs.values()), most_rows(robot))
    log, _ = pick(table, columns, robot, how)
    try:
        return _commands(log, robot, how, dt)
    except DataError as error:
        raise DataError(f"{printable(path.name)}: {error}") from None


def write_commands(controls: Floats, dt: float, path: str | Path, robot: Robot) -> Path:
    """Write commands (T, W), each for dt [s], in the format of `read_commands`.

    Raises:
      DataError: the file exists already, or cannot be written.
    """
    time = np.round(dt * np.arange(len(controls) + 1), 9)
    with new_csv(path) as writer:
        writer.writerow([TIME, *control_names(robot)])
        for now, row in zip(time.tolist(), controls.tolist(), strict=False):
            writer.writerow(map(repr, [now, *row]))
        writer.writerow([repr(float(time[-1])), *[""] * controls.shape[1]])
    return Path(path)


def _commands(log: Log, robot: Robot, how: RecordingMap, dt: float) -> Floats:
    check_commanded(log, robot)
    log, _ = without_duplicates(log)
    if len(log.time) < 2:
        raise DataError("all rows have one time; a script needs at least 2.")
    period = usual_period(log, dt)
    check_commands(log, robot)
    parts, _ = stretches(log, period)
    if len(parts) > 1:
        raise DataError(
            f"a gap: there are no commands from {parts[0].time[-1]:.6g} to {parts[1].time[0]:.6g} "
            f"s. Rows are {period:.4g} s apart; a script has one for every step, also without a "
            "change."
        )
    check_steps(parts, robot, dt)
    track, _ = on_grid(log, period, dt, how.jitter)
    return np.asarray(np.clip(track.controls, robot.control_low, robot.control_high))
