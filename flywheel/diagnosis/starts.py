"""Where and how fast a robot was when a window began, from the measurements around it."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.windows import Windows
from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.errors import DataError
from flywheel.records import Floats, Observation, Past, State

AROUND = 8  # samples to either side of the start
DEGREE = 2


def estimated_starts(windows: Windows, plant: Plant) -> State:
    """(K,) states: poses and velocities that fit the measurements best, rods relaxed about their axes.

    Raises:
      DataError: a point is never seen in a recording.
    """
    robot, dt = windows.robot, windows.dt
    places, speeds = smoothed(windows)
    winch = nominal_winch(windows)[:, 0]
    points = np.stack([places - speeds * dt, places], axis=1)
    hold = robot.holding(winch)[:, None]
    past = Past(
        Observation(points, np.repeat(winch[:, None], 2, axis=1)),
        hold,
        np.repeat(winch[:, None], 2, axis=1),
    )
    return RestartedPlant(plant, twist="relaxed").estimate(past)


def nominal_winch(windows: Windows) -> Floats:
    """(K, steps + 1, W) winch positions: measured, or dead-reckoned from the commands [m]."""
    known = [windows.robot.known_winch(log.winch, log.controls, windows.dt) for log in windows.logs]
    length = windows.steps + 1
    places = zip(windows.log, windows.first, strict=True)
    return np.stack([known[i][f : f + length] for i, f in places])


def smoothed(windows: Windows) -> tuple[Floats, Floats]:
    """(K, P, 3) places [m] and speeds [m/s] at each start, by parabolas through the samples around.

    A point that is hardly seen there is where it was seen next to it, and at rest.
    """
    found = [_smooth(windows, i, f) for i, f in zip(windows.log, windows.first, strict=True)]
    places, speeds = (np.stack(part) for part in zip(*found, strict=True))
    return places, speeds


def _smooth(windows: Windows, log: int, first: int) -> tuple[Floats, Floats]:
    points = windows.logs[log].points
    low, high = max(0, first - AROUND), min(len(points), first + AROUND + 1)
    near = points[low:high]
    known = np.asarray(np.isfinite(near).all(axis=-1))
    time = (np.arange(low, high) - first) * windows.dt
    powers = time[:, None] ** np.arange(DEGREE + 1)
    weights = known.T[..., None]  # (P, n, 1)
    fit = np.linalg.pinv(weights * powers) @ np.where(weights, near.swapaxes(0, 1), 0.0)
    place, speed = fit[:, 0], fit[:, 1]
    for point in np.flatnonzero(known.sum(axis=0) <= DEGREE):
        place[point], speed[point] = _nearest(points[:, point], first, log), 0.0
    return place, speed


def _nearest(path: Floats, first: int, log: int) -> Floats:
    """(3,) where a point was when it was seen next to a step: to go on from there would lead astray."""
    seen = np.flatnonzero(np.isfinite(path).all(axis=-1))
    if not len(seen):
        raise DataError(f"A point is never seen in recording {log}.")
    return np.asarray(path[seen[np.abs(seen - first).argmin()]])
