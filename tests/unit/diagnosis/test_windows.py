"""Recordings are cut without losing or inventing anything."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from flywheel.diagnosis.fitting.windows import Windows
from flywheel.errors import DataError
from flywheel.records import Observation, Trajectory
from flywheel.robots import Robot


def test_windows_tile_a_recording(windows: Windows, trajectory: Trajectory) -> None:
    assert list(windows.first) == [0, windows.steps]
    joined = np.concatenate([windows.measured[0], windows.measured[1][1:]])
    assert np.array_equal(joined, trajectory.observations.points[: len(joined)])
    assert [list(rank) for rank in windows.ranks] == [[0], [1]]


def test_what_is_missing_leaves_no_residual(windows: Windows) -> None:
    measured = windows.measured.copy()
    measured[0, 3, 2] = np.nan
    gappy = dataclasses.replace(windows, measured=measured)
    residual = gappy.residual(np.zeros_like(measured)).reshape(measured.shape)
    assert (residual[0, 3, 2] == 0).all()
    assert (residual[1] != 0).any()


def test_nothing_to_look_at_is_refused(robot: Robot, trajectory: Trajectory) -> None:
    with pytest.raises(DataError, match="no recording"):
        Windows.cut(robot, [])
    unseen = Observation(
        np.full_like(trajectory.observations.points, np.nan), trajectory.observations.winch
    )
    blind = Trajectory(unseen, trajectory.controls, trajectory.dt)
    with pytest.raises(DataError, match="the fullest has 0%"):
        Windows.cut(robot, [blind], sigma=0.01)


def test_recordings_of_two_rates_are_refused(robot: Robot, trajectory: Trajectory) -> None:
    other = dataclasses.replace(trajectory, dt=0.02)
    with pytest.raises(DataError, match=r"one control step, got \[0.01, 0.02\]"):
        Windows.cut(robot, [trajectory, other])
