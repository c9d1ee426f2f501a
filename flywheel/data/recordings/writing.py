"""Writing an episode in the CSV format of a robot's log, for `read_recording`."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.data.recordings.columns import TIME, control_names, point_names, winch_names
from flywheel.errors import DataError, RunError
from flywheel.faults import fault_of, told
from flywheel.records import Episode
from flywheel.robots import Robot


@contextmanager
def new_csv(path: str | Path) -> Iterator[Any]:
    """A `csv.writer` into a new file, which is removed if it could not be written completely.

    Raises:
      DataError: the file exists already, or cannot be written.
      RunError: the disk is full.
    """
    path, begun = Path(path), False
    try:
        with path.open("x", newline="") as file:
            begun = True
            yield csv.writer(file, lineterminator="\n")
    except FileExistsError:
        raise DataError(f"The file {path} exists already; it is not overwritten.") from None
    except BaseException as error:
        if begun:
            path.unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        fault, error.filename = fault_of(error), str(path)
        kind = DataError if fault is None or fault.by_input else RunError
        raise kind(f"The log cannot be written: {told(error)}") from None


def write_recording(episode: Episode, path: str | Path, robot: Robot) -> tuple[str, ...]:
    """Write an episode's observations and controls.

    Row t contains the points at time t and the commands from t on; the last row has no commands.
    Unmeasured cells are empty.

    Returns:
      Content that a log cannot hold: "state", and winches with known positions but without a sensor
      in the MJCF.

    Raises:
      DataError: the file exists already, or the episode is of another robot.
    """
    if episode.provenance.robot != robot.digest:
        raise DataError(
            f"Episode {episode.id} is of the robot {episode.provenance.robot[:12]}, not of {robot.name} "
            f"({robot.digest[:12]})."
        )
    track, sensors = episode.trajectory, winch_names(robot)
    seen = track.observations
    columns = [
        np.round(track.dt * np.arange(track.steps + 1), 9)[:, None],
        np.concatenate([track.controls, np.full((1, track.controls.shape[1]), np.nan)]),
        seen.points.reshape(track.steps + 1, -1),
        seen.winch[:, list(sensors.values())],
    ]
    with new_csv(path) as writer:
        writer.writerow([TIME, *control_names(robot), *point_names(robot), *sensors])
        for row in np.concatenate(columns, axis=1):
            writer.writerow([repr(x) if isfinite(x) else "" for x in row.tolist()])
    known = np.asarray(np.isfinite(seen.winch).any(axis=0))
    left = [w.name for i, w in enumerate(robot.winches) if known[i] and not w.sensor]
    return (*(["state"] if track.states is not None else []), *left)
