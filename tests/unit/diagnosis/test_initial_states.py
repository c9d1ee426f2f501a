"""Where windows begin is estimated from samples around, and not made up where there are few."""

import dataclasses

import numpy as np
import pytest

from flywheel.diagnosis.fitting.initial_states import smoothed
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.effects import Scales
from flywheel.errors import DataError
from flywheel.records import Floats
from tests import draws

SIGMA = 0.003  # of the robot's length, as of a motion capture


@pytest.fixture
def thrown(windows: Windows) -> tuple[Windows, Floats, Floats]:
    """Windows of points that fly, as measured; places and speeds where the windows begin."""
    rng, scales = np.random.default_rng(draws.seed()), Scales.of(windows.robot)
    count = len(windows.robot.points)
    length, speed, acceleration = (
        scales.length * scale * rng.normal(size=(count, 3)) for scale in (1.0, 0.3, 0.5)
    )
    tau = np.arange(len(windows.recordings[0].points))[:, None, None] * windows.dt / scales.time
    paths = length + speed * tau + acceleration * tau**2 / 2
    speeds = (speed + acceleration * tau) / scales.time
    noisy = paths + rng.normal(size=paths.shape) * SIGMA * scales.length
    recording = dataclasses.replace(windows.recordings[0], points=noisy)
    sigma = SIGMA * scales.length
    measured = dataclasses.replace(windows, recordings=(recording,), sigma=sigma)
    return measured, paths[windows.first], speeds[windows.first]


def hidden(windows: Windows, point: int, samples: slice) -> Windows:
    (recording,) = windows.recordings
    points = recording.points.copy()
    points[samples, point] = np.nan
    unseen = dataclasses.replace(recording, points=points)
    return dataclasses.replace(windows, recordings=(unseen,))


def off(windows: Windows, places: Floats, speeds: Floats) -> tuple[Floats, Floats]:
    """(K, P) errors of places and speeds in natural units."""
    scales = Scales.of(windows.robot)
    found = smoothed(windows)
    place, speed = (
        np.linalg.norm(a - b, axis=-1) for a, b in zip(found, (places, speeds), strict=True)
    )
    return place / scales.length, speed * scales.time / scales.length


def test_a_motion_that_is_seen_is_met_better_than_by_one_sample(thrown) -> None:
    place, speed = off(*thrown)
    assert np.sqrt((place**2).mean()) < np.sqrt(3) * SIGMA
    assert speed.max() < 0.3


@pytest.mark.parametrize("seen", [0, 1, 4, 6])
def test_a_gap_after_a_beginning_is_not_bridged_by_what_few_samples_say(thrown, seen) -> None:
    windows, places, speeds = thrown
    first = int(windows.first[0])
    gap = slice(first, first + 9 - seen)  # of the first samples, none before that
    place, speed = off(hidden(windows, 2, gap), places, speeds)
    assert place[0, 2] < 0.1
    assert speed[0, 2] < 0.6


def test_a_gap_around_a_beginning_is_bridged_from_both_sides(thrown) -> None:
    windows, places, speeds = thrown
    first = int(windows.first[1])
    place, speed = off(hidden(windows, 1, slice(first - 10, first + 11)), places, speeds)
    assert place[1, 1] < 8 * SIGMA
    assert speed[1, 1] < 0.2


def test_a_point_that_comes_late_is_about_where_it_is_seen_then(thrown) -> None:
    windows, _, _ = thrown
    late = len(windows.recordings[0].points) - 3
    found, _ = smoothed(hidden(windows, 0, slice(0, late)))
    there = windows.recordings[0].points[late, 0]
    assert np.linalg.norm(found[0, 0] - there) < 0.5 * windows.robot.length


def test_a_point_that_is_never_seen_is_refused(thrown) -> None:
    windows, _, _ = thrown
    with pytest.raises(DataError, match="never seen in recording 0"):
        smoothed(hidden(windows, 3, slice(None)))
