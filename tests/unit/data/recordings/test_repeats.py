"""Samples that only repeat the one before them are no measurements, unless they may well be equal."""

import numpy as np
import pytest

from flywheel.data.recordings import read_recording
from flywheel.data.recordings.repair.repeats import mask_repeats
from flywheel.data.recordings.tables.columns import Log
from flywheel.robots import Robot, load_robot
from tests.unit.data.recordings.conftest import SEED

ROWS = 1500


def at_times(points: np.ndarray, robot: Robot) -> Log:
    """A log in which all markers are at points (N, 3), each shifted a little."""
    shifts = 0.1 * np.arange(len(robot.points))[:, None]
    values, nothing = points[:, None] + shifts, np.zeros((len(points), 6))
    return Log(0.01 * np.arange(len(points)), nothing, values, nothing, np.arange(len(points)))


def masked(points: np.ndarray, robot: Robot) -> np.ndarray:
    """(N, P) which samples are masked."""
    log = at_times(points, robot)
    mask_repeats(log, robot)
    return np.isnan(log.points[..., 0])


def swinging() -> np.ndarray:
    phases = 2 * np.pi * np.arange(ROWS)[:, None] / [131.7, 173.3, 211.9]
    return np.asarray(0.1 * np.sin(phases))


@pytest.mark.parametrize("frozen", [("s2",), ("s0", "s1", "s2", "s3", "s4", "s5")])
@pytest.mark.parametrize("place", ["begin", "middle", "end"])
def test_a_time_in_which_markers_are_frozen_is_masked_and_told(frozen, place, sheet):
    log = sheet()
    begin = {"begin": 0, "middle": int(log.rng.integers(10, 120)), "end": 160}[place]
    end = min(begin + 60, len(log.rows))
    for name in frozen:
        values = log.positions(name)
        values[begin:end] = values[begin]
        log.move(name, values)
    read = read_recording(log.save(), log.robot)
    told = {(f.kind, f.subject): f for f in read.report.findings if f.kind == "repeat"}
    assert sorted(told) == [("repeat", name) for name in frozen], SEED
    assert {f.count for f in told.values()} == {end - begin - 1}
    assert all("was tracking lost?" in f.words for f in told.values())
    valid = read.episodes[0].trajectory.observations.valid
    columns = [int(name[1:]) for name in frozen]
    assert not valid[begin + 1 : end, columns].any()


@pytest.mark.parametrize(("every", "rate"), [(2, "50 Hz"), (4, "25 Hz"), (10, "10 Hz")])
def test_a_slower_tracker_that_is_held_gives_its_own_samples_only(every, rate, sheet):
    log = sheet()
    held = every * (np.arange(len(log.rows)) // every)
    for point in log.robot.points:
        log.move(point.name, log.positions(point.name)[held])
    read = read_recording(log.save(), log.robot)
    valid = read.episodes[0].trajectory.observations.valid
    expected = np.arange(len(log.rows)) % every == 0
    np.testing.assert_array_equal(valid, np.repeat(expected[:, None], 6, axis=1))
    told = {f.words for f in read.report.findings}
    assert (
        len(told) == 1 and f"new ones come {every} rows apart: a tracker of {rate}?" in told.pop()
    )


def test_a_repeat_after_a_sample_that_was_not_seen_is_one_too(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    points = (swinging() + 1e-3 * rng.standard_normal((ROWS, 3)))[4 * (np.arange(ROWS) // 4)]
    points[2::4] = np.nan
    assert not (~masked(points, robot))[np.arange(ROWS) % 4 != 0].any()


@pytest.mark.parametrize("every", [2, 3])
def test_a_slower_tracker_without_noise_is_known_by_the_motion(every: int, robot: Robot) -> None:
    found = masked(swinging()[every * (np.arange(ROWS) // every)], robot)
    moving = np.arange(ROWS) >= 2 * every  # what stands at the beginning may have begun to move
    expected = np.repeat((np.arange(ROWS) % every != 0)[:, None], 6, axis=1)
    np.testing.assert_array_equal(found[moving], expected[moving])


@pytest.mark.parametrize("digits", [3, 4, 5, 6, 9, 17])
def test_a_robot_that_rests_without_noise_is_not_masked(digits: int, robot: Robot) -> None:
    """It settles, rests, moves off and settles again, as simulations do."""
    time = 0.01 * np.arange(ROWS)
    moved = np.where(time < 5, 0.0, 0.3 * (1 - (1 + 8 * (time - 5)) * np.exp(-8 * (time - 5))))
    ringing = np.exp(-np.minimum(time, 5) * 6) * np.cos(40 * np.minimum(time, 5))
    points = np.stack([moved + 0.05 * ringing, 0.02 * ringing, np.ones(ROWS)], axis=1)
    assert not masked(np.round(points, digits), robot).any()


def test_a_robot_that_begins_at_rest_and_is_struck_is_not_masked(robot: Robot) -> None:
    time = 0.01 * np.arange(ROWS)
    points = np.zeros((ROWS, 3))
    points[:, 0] = 0.05 * np.sin(30 * np.maximum(time - 4, 0)) * np.exp(-np.maximum(time - 4, 0))
    assert not masked(np.round(points, 5), robot).any()


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_coarse_digits_are_not_masked(share: float, robot: Robot) -> None:
    rng = np.random.default_rng(2)
    points = swinging() * (np.arange(ROWS) > 700)[:, None] + 1e-3 * share * rng.standard_normal(
        (ROWS, 3)
    )
    assert not masked(np.round(points, 3), robot).any()


def test_a_coordinate_that_is_constant_by_construction_is_not_masked(robot: Robot) -> None:
    rng = np.random.default_rng(3)
    points = swinging() + 1e-3 * rng.standard_normal((ROWS, 3))
    points[:, 1] = 0.25
    assert not masked(points, robot).any()
    points[300:400] = points[300]
    expected = (np.arange(ROWS) > 300) & (np.arange(ROWS) < 400)
    np.testing.assert_array_equal(masked(points, robot), np.repeat(expected[:, None], 6, axis=1))


def test_a_marker_that_never_moves_is_not_masked(robot: Robot) -> None:
    assert not masked(np.full((ROWS, 3), 0.7), robot).any()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_marker_of_which_one_coordinate_is_stuck_is_masked(axis: int, robot: Robot) -> None:
    points = swinging() + 1e-3 * np.random.default_rng(4).standard_normal((ROWS, 3))
    points[300:400, axis] = points[300, axis]
    expected = (np.arange(ROWS) > 300) & (np.arange(ROWS) < 400)
    np.testing.assert_array_equal(masked(points, robot), np.repeat(expected[:, None], 6, axis=1))


def test_a_winch_sensor_that_is_stuck_is_masked_and_told(sheet):
    log = sheet("platform4")
    winch, name = next((i, w.sensor) for i, w in enumerate(log.robot.winches) if w.sensor)
    values = log.column(name)
    values[60:120] = values[60]
    log.put(name, values)
    read = read_recording(log.save(), log.robot)
    told = [(f.kind, f.action, f.subject, f.count) for f in read.report.findings]
    assert told == [("repeat", "masked", name, 59)], SEED
    known = np.isfinite(read.episodes[0].trajectory.observations.winch[:, winch])
    np.testing.assert_array_equal(np.flatnonzero(~known), np.arange(61, 120))


def test_a_winch_without_noise_that_stops_for_a_while_is_not_masked() -> None:
    robot = load_robot("platform4")
    index = next(i for i, w in enumerate(robot.winches) if w.sensor)
    rates = np.repeat([0.1, 0.0, -0.05, 0.0, 0.1], ROWS // 5)
    winch = np.full((ROWS, len(robot.winches)), np.nan)
    winch[:, index] = 1.0 + np.cumsum(0.01 * rates)
    points = np.full((ROWS, len(robot.points), 3), np.nan)
    log = Log(0.01 * np.arange(ROWS), 0 * winch, points, winch, np.arange(ROWS))
    assert not mask_repeats(log, robot) and np.isfinite(log.winch[:, index]).all()


def test_rows_that_were_sent_twice_are_masked_and_a_periodic_motion_without_noise_is_not(robot):
    points = swinging() + 1e-3 * np.random.default_rng(5).standard_normal((ROWS, 3))
    points[300:360] = points[200:260]
    expected = (np.arange(ROWS) >= 300) & (np.arange(ROWS) < 360)
    np.testing.assert_array_equal(masked(points, robot), np.repeat(expected[:, None], 6, axis=1))
    (finding,) = mask_repeats(at_times(points, robot), robot)
    assert finding.words.endswith("was it sent twice?") and finding.count == 60
    assert not masked(swinging()[np.arange(ROWS) % 250], robot).any()
