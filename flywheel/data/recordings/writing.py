"""Writing an episode in the CSV format of a robot's log, for `read_recording`."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.data.recordings.tables.columns import TIME, control_names, point_names, winch_names
from flywheel.errors import DataError, RunError
from flywheel.faults import fault_of, told
from flywheel.records import Episode, Floats, MeasuredChannel
from flywheel.robots import Robot


@contextmanager
def created(path: str | Path) -> Iterator[Path]:
    """The place of a new file or folder, which is removed if it could not be written completely.

    Raises:
      DataError: it exists already, or cannot be written.
      RunError: the disk is full.
    """
    path, begun = Path(path), False
    try:
        if path.exists() or path.is_symlink():
            raise FileExistsError
        begun = True
        yield path
    except FileExistsError:
        raise DataError(f"The file {path} exists already; it is not overwritten.") from None
    except BaseException as error:
        if begun:
            with suppress(OSError):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        if not isinstance(error, OSError):
            raise
        fault, error.filename = fault_of(error), str(path)
        kind = DataError if fault is None or fault.by_input else RunError
        raise kind(f"The log cannot be written: {told(error)}") from None


@contextmanager
def new_csv(path: str | Path) -> Iterator[Any]:
    """A `csv.writer` into a new file; see `created`."""
    with created(path) as place, place.open("x", newline="") as file:
        yield csv.writer(file, lineterminator="\n")


@dataclass(frozen=True)
class Logged:
    """Content of an episode that a log can hold; NaN where nothing was measured.

    Attributes:
      time: (T + 1,) [s].
      controls: (T, W) commands, each from its time on.
      points: (T + 1, P, 3) [m].
      winch: (T + 1, S) measured winch positions, of those with a sensor [m].
      sensors: (S,) their names.
      channels: measured tensions and lengths of cables.
      left: content that a log cannot hold: "state", and winches with known positions but without a sensor.
    """

    time: Floats
    controls: Floats
    points: Floats
    winch: Floats
    sensors: tuple[str, ...]
    channels: tuple[MeasuredChannel, ...]
    left: tuple[str, ...]

    @classmethod
    def of(cls, episode: Episode, robot: Robot) -> Logged:
        """The content of an episode.

        Raises:
          DataError: it is of another robot.
        """
        if episode.provenance.robot != robot.digest:
            raise DataError(
                f"Episode {episode.id} is of the robot {episode.provenance.robot[:12]}, not of {robot.name} "
                f"({robot.digest[:12]})."
            )
        track, sensors = episode.trajectory, winch_names(robot)
        seen = track.observations
        known = np.asarray(np.isfinite(seen.winch).any(axis=0))
        left = [w.name for i, w in enumerate(robot.winches) if known[i] and not w.sensor]
        return cls(
            np.round(track.dt * np.arange(track.steps + 1), 9),
            track.controls,
            seen.points,
            seen.winch[:, list(sensors.values())],
            tuple(sensors),
            tuple(channel for channel in track.channels if channel.kind != "winch"),
            (*(["state"] if track.states is not None else []), *left),
        )


def write_recording(episode: Episode, path: str | Path, robot: Robot) -> tuple[str, ...]:
    """Write an episode's observations and controls.

    Row t contains the points at time t and the commands from t on; the last row has no commands.
    Unmeasured cells are empty.

    Returns:
      Content that a log cannot hold, see `Logged`.

    Raises:
      DataError: the file exists already, or the episode is of another robot.
    """
    log = Logged.of(episode, robot)
    columns = [
        log.time[:, None],
        np.concatenate([log.controls, np.full((1, log.controls.shape[1]), np.nan)]),
        log.points.reshape(len(log.time), -1),
        log.winch,
        *(channel.values[:, None] for channel in log.channels),
    ]
    beside = [*log.sensors, *(f"{channel.kind}.{channel.name}" for channel in log.channels)]
    with new_csv(path) as writer:
        writer.writerow([TIME, *control_names(robot), *point_names(robot), *beside])
        for row in np.concatenate(columns, axis=1):
            writer.writerow([repr(x) if isfinite(x) else "" for x in row.tolist()])
    return log.left
