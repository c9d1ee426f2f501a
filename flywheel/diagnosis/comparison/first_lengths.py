"""Where winches were when recordings began, where nobody measured it.

A log may begin in motion, and rest lengths reckoned from the keyframe are then off from its first row to
its last. As in a diagnosis they are fitted, beside the initial states of the first windows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.fitting.model import fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.settings import Settings
from flywheel.dynamics.plant import Plant
from flywheel.records import Trajectory

WINDOWS = 3  # that lengths are fitted to: later ones are off by more of what the model lacks


def with_first_lengths(
    windows: ForecastWindows, plant: Plant, settings: Settings = Settings()
) -> ForecastWindows:
    """The same windows, of winches that began where a plant fits best.

    Args:
      windows: whose recordings they are.
      plant: to be fitted, with the terms that it has.
      settings: tuned numbers, as of a diagnosis.

    Returns:
      The windows themselves where every winch was measured in the first row, or where no fit is finite.
    """
    first = np.stack([each.trajectory.observations.winch[0] for each in windows.recordings])
    unknown = ~np.isfinite(first)
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
    return windows.starting_at(np.where(unknown, fitted, first))


def _first_windows(windows: ForecastWindows, recording: int) -> Trajectory:
    """A recording up to the end of its first windows."""
    track = windows.recordings[recording].trajectory
    end = int(windows.first[windows.recording == recording].min()) + WINDOWS * windows.steps
    return replace(
        track,
        observations=track.observations[: end + 1],
        controls=track.controls[:end],
        states=None,
    )
