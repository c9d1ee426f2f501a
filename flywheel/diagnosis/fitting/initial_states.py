"""Where and how fast a robot was when a window began, from the measurements around it."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.settings import InitialStateSettings
from flywheel.dynamics.plant import Plant, Reckoning, RestartedPlant
from flywheel.effects import Scales
from flywheel.errors import DataError
from flywheel.records import Floats, Observation, Past, State, Trajectory


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
    return RestartedPlant(plant, twist="relaxed").estimate(past)


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
    """(K, P, 3) places [m] and speeds [m/s] at each window's begin, by parabolas through the samples around.

    A parabola holds for a while only: what the motion may have changed by then counts as noise of a
    sample, so that those nearby decide. Where there are few of them, speed and acceleration are what is
    usual: a gap beside a start must not be bridged by what a few samples seem to say (local Bayesian
    regression).

    Raises:
      DataError: a point is never seen in a recording.
    """
    at = zip(windows.recording, windows.first, strict=True)
    found = [_smooth(windows, i, f, settings) for i, f in at]
    places, speeds = (np.stack(part) for part in zip(*found, strict=True))
    return places, speeds


def _smooth(
    windows: Windows, recording: int, first: int, settings: InitialStateSettings
) -> tuple[Floats, Floats]:
    points, scales = windows.recordings[recording].points, Scales.of(windows.robot)
    around = _around(points, first, round(settings.reach * scales.time / windows.dt), recording)
    near = points[around]
    known = np.asarray(np.isfinite(near).all(axis=-1))
    time = (np.arange(len(points))[around] - first) * windows.dt / scales.time
    powers = np.stack([np.ones_like(time), time, time**2 / 2], axis=1)
    variance = (windows.sigma / scales.length) ** 2 + (settings.jerk * time**3 / 6) ** 2
    weighted = (known.T / variance)[..., None] * powers  # (P, n, 3)
    usual = np.diag([0.0, settings.speed**-2, settings.acceleration**-2])
    seen = np.where(known[..., None], near, 0.0).swapaxes(0, 1)
    fit = np.linalg.solve(weighted.swapaxes(1, 2) @ powers + usual, weighted.swapaxes(1, 2) @ seen)
    return fit[:, 0], fit[:, 1] / scales.time


def _around(points: Floats, first: int, reach: int, recording: int) -> slice:
    """Samples around one, as far as every point of (T + 1, P, 3) is seen there at least once."""
    unseen = ~np.isfinite(points).all(axis=-1).any(axis=0)
    if unseen.any():
        raise DataError(f"A point is never seen in recording {recording}.")
    while True:
        around = slice(max(0, first - reach), first + reach + 1)
        if np.isfinite(points[around]).all(axis=-1).any(axis=0).all():
            return around
        reach *= 2
