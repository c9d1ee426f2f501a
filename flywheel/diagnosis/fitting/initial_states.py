"""Initial state of a robot at the start of a window, from the measurements around it."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.settings import InitialStateSettings
from flywheel.dynamics.plant import Plant, Reckoning, RestartedPlant
from flywheel.effects import Scales
from flywheel.errors import DataError
from flywheel.records import Floats, Observation, Past, State, Trajectory
from flywheel.smoothing import local_regression


def estimated_initial_states(
    windows: Windows, plant: Plant, settings: InitialStateSettings = InitialStateSettings()
) -> State:
    """(K,) states: poses and velocities that fit the measurements best, rods relaxed about their axes.

    Raises:
      DataError: a point is never seen in a recording.
    """
    robot, dt = windows.robot, windows.dt
    places, speeds = smoothed(windows, settings)
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
        for log in windows.recordings
    ]
    known = [reckoning.known(track) for track in tracks]
    length = windows.steps + 1
    places = zip(windows.recording, windows.first, strict=True)
    return np.stack([known[i][f : f + length] for i, f in places])


def smoothed(
    windows: Windows, settings: InitialStateSettings = InitialStateSettings()
) -> tuple[Floats, Floats]:
    """(K, P, 3) positions [m] and velocities [m/s] at each window's start, by `local_regression`.

    Raises:
      DataError: a point is never seen in a recording.
    """
    scales, dt = Scales.of(windows.robot), windows.dt
    for index, recording in enumerate(windows.recordings):
        seen = np.isfinite(recording.points).all(axis=-1).any(axis=0)
        if index in windows.recording and not seen.all():
            raise DataError(f"A point is never seen in recording {index}.")
    reach, sigma = round(settings.reach * scales.time / dt), windows.noise / scales.length
    found = [
        local_regression(
            windows.recordings[i].points, first, reach, dt, scales.time, sigma, settings.motion
        )
        for i, first in zip(windows.recording, windows.first, strict=True)
    ]
    places, speeds = (np.stack(part) for part in zip(*found, strict=True))
    return places, speeds
