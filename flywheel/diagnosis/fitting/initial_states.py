"""Where and how fast a robot was when a window began, from the measurements around it."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.fitting.windows import Windows
from flywheel.dynamics.plant import Plant, Reckoning, RestartedPlant
from flywheel.effects import Scales
from flywheel.errors import DataError
from flywheel.records import Floats, Observation, Past, State, Trajectory
from flywheel.smoothing import local_regression

REACH = 1.0  # of the samples to either side of a start that are looked at [sqrt(L / g)]


def estimated_starts(windows: Windows, plant: Plant) -> State:
    """(K,) states: poses and velocities that fit the measurements best, rods relaxed about their axes.

    Raises:
      DataError: a point is never seen in a recording.
    """
    robot, dt = windows.robot, windows.dt
    places, speeds = smoothed(windows)
    winch = nominal_winch(windows, Reckoning(robot, dt, plant.terms))[:, 0]
    points = np.stack([places - speeds * dt, places], axis=1)
    hold = robot.holding(winch)[:, None]
    past = Past(
        Observation(points, np.repeat(winch[:, None], 2, axis=1)),
        hold,
        np.repeat(winch[:, None], 2, axis=1),
    )
    return RestartedPlant(plant, roll="relaxed").estimate(past)


def nominal_winch(windows: Windows, reckoning: Reckoning | None = None) -> Floats:
    """(K, steps + 1, W) winch positions: measured, or dead-reckoned; as of nominal winches by default [m]."""
    reckoning = reckoning or Reckoning(windows.robot, windows.dt)
    tracks = [
        Trajectory(Observation(log.points, log.winch), log.controls, windows.dt)
        for log in windows.logs
    ]
    known = [reckoning.known(track) for track in tracks]
    length = windows.steps + 1
    places = zip(windows.log, windows.first, strict=True)
    return np.stack([known[i][f : f + length] for i, f in places])


def smoothed(windows: Windows) -> tuple[Floats, Floats]:
    """(K, P, 3) positions [m] and velocities [m/s] at each start, by `local_regression`.

    Raises:
      DataError: a point is never seen in a recording.
    """
    scales, dt = Scales.of(windows.robot), windows.dt
    for log in np.unique(windows.log).tolist():
        if not np.isfinite(windows.logs[log].points).all(axis=-1).any(axis=0).all():
            raise DataError(f"A point is never seen in recording {log}.")
    reach, sigma = round(REACH * scales.time / dt), windows.sigma / scales.length
    found = [
        local_regression(windows.logs[log].points, first, reach, dt, scales.time, sigma)
        for log, first in zip(windows.log, windows.first, strict=True)
    ]
    places, speeds = (np.stack(part) for part in zip(*found, strict=True))
    return places, speeds
