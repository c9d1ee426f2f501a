"""Logs of laboratories, rewritten in the format of `flywheel`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flywheel.data.recordings import write_recording
from flywheel.records import Episode, Floats, Observation, Provenance, Trajectory
from flywheel.robots import Robot


def write_log(
    path: Path, points: Floats, commands: Floats, begin: Floats, dt: float, robot: Robot
) -> None:
    """Write a log, replacing an existing file.

    Args:
      path: of the CSV file.
      points: (S + 1, P, 3) markers [m].
      commands: (S, W) of the winches.
      begin: (W,) initial winch positions [m], unmeasured afterwards.
      dt: time between two rows [s].
      robot: of the log.
    """
    wound = np.full((len(points), len(begin)), np.nan)
    wound[0] = begin
    track = Trajectory(Observation(points, wound), commands, dt)
    path.unlink(missing_ok=True)
    write_recording(Episode(path.stem, track, Provenance(robot.digest), "train"), path, robot)
