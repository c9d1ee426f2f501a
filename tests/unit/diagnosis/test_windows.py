"""Recordings are cut without losing or inventing anything, and their noise is found from them alone."""

import dataclasses

import numpy as np
import pytest

from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.settings import WindowSettings
from flywheel.errors import DataError
from flywheel.noise import filled_in, noise_floor
from flywheel.records import Observation, Trajectory
from flywheel.robots import Robot, load_robot
from tests import draws


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
    with pytest.raises(DataError, match="A window of 0.01 s of a recording of .* has 1 steps of"):
        Windows.cut(robot, [trajectory], seconds=0.01)


def test_recordings_of_two_rates_are_refused(robot: Robot, trajectory: Trajectory) -> None:
    other = dataclasses.replace(trajectory, dt=0.02)
    with pytest.raises(DataError, match=r"one control step, got \[0.01, 0.02\]"):
        Windows.cut(robot, [trajectory, other])


def test_a_noise_that_was_given_is_not_estimated(robot: Robot, trajectory: Trajectory) -> None:
    given = WindowSettings(noise=0.004)
    for sigma, wanted in ((None, 0.004), (0.002, 0.002)):
        windows = Windows.cut(robot, [trajectory], sigma=sigma, settings=given)
        assert (windows.sigma, windows.doubt) == (wanted, 0.0)
    assert Windows.cut(robot, [trajectory]).doubt > 0.0


def moving(rng: np.random.Generator, samples: int = 400) -> np.ndarray:
    """(samples, 3, 3) points that swing smoothly, by metres."""
    time = np.arange(samples)[:, None, None] * 0.01
    frequency, phase = rng.uniform(0.2, 2.0, (3, 3)), rng.uniform(0, 6, (3, 3))
    return np.sin(2 * np.pi * frequency * time + phase)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(draws.seed())


def test_noise_is_found_beside_motion_a_thousand_times_larger(rng: np.random.Generator) -> None:
    sigma = 10 ** rng.uniform(-3, -2)
    points = moving(rng) + rng.normal(0, sigma, (400, 3, 3))
    assert noise_floor([points]) == pytest.approx(sigma, rel=0.1)


def test_gaps_and_leaps_do_not_change_the_noise_much(rng: np.random.Generator) -> None:
    points = moving(rng) + rng.normal(0, 0.005, (400, 3, 3))
    points[rng.random((400, 3)) < 0.05] = np.nan
    points[rng.integers(0, 400, 3)] += 0.5
    assert noise_floor([points]) == pytest.approx(0.005, rel=0.15)


def test_coordinates_that_never_change_say_nothing_of_the_noise(rng: np.random.Generator) -> None:
    """A planar robot's third one, and a marker on the frame."""
    points = moving(rng) + rng.normal(0, 0.005, (400, 3, 3))
    points[:, :, 1], points[:, 2] = 0.3, [1.0, 2.0, 0.3]
    assert noise_floor([points]) == pytest.approx(0.005, rel=0.15)
    points[:] = points[0]
    with pytest.raises(DataError, match="got 0; coordinates that never change"):
        noise_floor([points])


def test_what_never_changes_beside_noise_was_filled_in(rng: np.random.Generator) -> None:
    points = moving(rng) + rng.normal(0, 0.005, (400, 3, 3))
    points[:, :, 1] = 0.3
    log = Trajectory(Observation(points, np.full((400, 4), np.nan)), np.zeros((399, 4)), 0.01)
    windows = Windows.cut(load_robot("platform4"), [log], 0.5)
    assert not windows.noisy[..., 1].any() and windows.noisy[..., ::2].all()
    off = np.where(windows.noisy, windows.sigma, 0.0)
    squares = windows.mean_square(windows.residual(windows.measured - off))
    np.testing.assert_allclose(squares, 1.0)
    aside = windows.residual(windows.measured + [0.0, 0.1, 0.0])
    assert np.abs(aside).max() > 1.0  # it is held where it is said to be


def test_of_a_sensor_that_counts_in_steps_what_rests_was_measured(rng: np.random.Generator) -> None:
    """Unless other coordinates of the point change: then nobody measured the one that does not."""
    counted = np.round(moving(rng) / 20.0 + rng.normal(0, 0.002, (400, 3, 3)), 2)
    counted[:, 0], counted[:, 1, 2] = 0.3, 0.1
    filled = filled_in([counted])[0]
    assert filled[1, 2] and filled.sum() == 1


def test_a_point_that_is_seen_in_every_other_sample_was_measured(rng: np.random.Generator) -> None:
    points = moving(rng) + rng.normal(0, 0.005, (400, 3, 3))
    points[::2, 1] = np.nan
    assert not filled_in([points]).any()


def test_a_sensor_that_counts_in_steps_is_as_good_as_they_are(rng: np.random.Generator) -> None:
    counted = np.round(moving(rng) / 100.0, 2)  # most values are those before
    assert noise_floor([counted]) == pytest.approx(0.01 / np.sqrt(12.0), rel=1e-3)


def test_steady_motion_is_no_step_of_a_sensor(rng: np.random.Generator) -> None:
    steady = np.arange(400.0)[:, None, None] * 0.01 + rng.normal(0, 1e-5, (400, 1, 1))
    points = np.concatenate([steady, np.full((400, 1, 2), 0.3)], axis=2)
    points[::2, 0, 1] += 1e-16  # computed, and not measured
    assert noise_floor([points]) == pytest.approx(1e-5, rel=0.2)


def test_too_few_samples_for_the_noise_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(DataError, match="differences over 5 samples in a row, got"):
        noise_floor([moving(rng, 6)])


def test_where_a_sensor_is_slower_the_step_that_has_all_its_samples_is_named(rng):
    slower = moving(rng)
    slower[np.arange(len(slower)) % 4 != 0] = np.nan
    with pytest.raises(
        DataError, match="are 4 control steps apart: a --dt 4 times as long has all"
    ):
        noise_floor([slower])
    with pytest.raises(DataError, match="do not count.$"):
        noise_floor([np.full((400, 3, 3), np.nan)])
    uneven = moving(rng)
    uneven[np.setdiff1d(np.arange(400), np.cumsum(rng.integers(3, 8, 100)))] = np.nan
    with pytest.raises(DataError, match="but not evenly: only diagnose can use them, with --noise"):
        noise_floor([uneven])
