"""Unmeasured winch positions at the start of recordings.

A log that begins with cables as long as at the keyframe began there. Any other may begin in motion, and rest
lengths reckoned from the keyframe are then off from its first row to its last. As in a diagnosis they are
fitted, beside the initial states of the first windows.
"""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.comparison.regions import span_noise, spans
from flywheel.diagnosis.fitting.model import fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.settings import Settings
from flywheel.dynamics.plant import Plant
from flywheel.records import State, Trajectory

SURE = 4.0  # standard deviations of the noise
WINDOWS = 3  # that lengths are fitted to: later ones are off by more of what the model lacks


def with_first_lengths(
    windows: ForecastWindows, plant: Plant, settings: Settings = Settings()
) -> ForecastWindows:
    """The same windows, with the first winch positions that fit a plant best.

    Args:
      windows: of the recordings.
      plant: to be fitted, with its terms.
      settings: as in a diagnosis.

    Returns:
      The windows themselves where every winch was measured in the first row, or takes tensions, where all
      logs began at the keyframe, or where no fit is finite.
    """
    if plant.robot.tension_driven:
        return windows
    first = np.stack([each.trajectory.observations.winch[0] for each in windows.recordings])
    unknown = ~np.isfinite(first) & ~_at_keyframe(windows, plant, settings)[:, None]
    used = [i for i in sorted(set(windows.recording.tolist())) if unknown[i].any()]
    if not used:
        return windows
    begun = [_first_windows(windows, i) for i in used]
    seconds = windows.steps * windows.dt
    cut = Windows.cut(plant.robot, begun, seconds, windows.sigma, settings.windows)
    fitter = fitter_of(cut, plant, settings=settings.fitting)
    fit = fitter.fit(fitter.first_estimate(plant.terms))
    if not np.isfinite(fit.cost):
        return windows
    robot = plant.robot
    offset = np.zeros_like(first)
    offset[used] = fit.initial.winch
    fitted = np.clip(robot.winch_of(robot.keyframe) + offset, robot.rest_low, robot.rest_high)
    return windows.starting_at(np.where(np.isfinite(first), first, fitted))


def _at_keyframe(windows: ForecastWindows, plant: Plant, settings: Settings) -> np.ndarray:
    """(recordings,) bool: cables are as long in the first row as at the keyframe, as far as can be seen."""
    robot, home = plant.robot, plant.robot.keyframe
    state = State(home.qpos[None], home.qvel[None], home.act[None])
    points = np.stack([each.trajectory.observations.points[0] for each in windows.recordings])
    off = np.abs(spans(robot, points) - spans(robot, plant.observe(state).points))
    near = settings.fitting.initial_states.winch_prior * robot.length
    return np.asarray((off <= near + SURE * windows.sigma * span_noise(robot)).all(axis=1))


def _first_windows(windows: ForecastWindows, recording: int) -> Trajectory:
    """A recording up to the end of its first windows."""
    track = windows.recordings[recording].trajectory
    end = int(windows.first[windows.recording == recording].min()) + WINDOWS * windows.steps
    return track.first(end)
