"""Many rows are decided at once as they would be one after the other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from flywheel.data.recordings import following
from flywheel.data.recordings.markers import track
from tests.unit.data.recordings.conftest import Sheet


def mishaps(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points (N, P, 3) with markers exchanged, lost, leaping, left behind and frozen."""
    points, (rows, count) = points.copy(), points.shape[:2]
    for _ in range(rng.integers(2, 14)):
        begin = int(rng.integers(0, rows))
        end = begin + int(rng.integers(1, 60))
        one, two = rng.choice(count, 2, replace=False)
        what = rng.integers(5)
        if what == 0:
            points[begin:end, [one, two]] = points[begin:end, [two, one]]
        elif what == 1:
            points[begin:end, one] = np.nan
        elif what == 2:
            points[begin:end, one] += rng.choice([0.05, 0.5, 3.0, 30.0]) * rng.standard_normal(3)
        elif what == 3:
            points[begin:end] = np.nan
        else:
            points[begin:end, one] = points[begin, one]
    points[rng.random((rows, count)) < rng.choice([0.0, 0.2])] = np.nan
    return points


@pytest.mark.parametrize("seed", range(12))
def test_how_many_rows_are_decided_at_once_makes_no_difference(
    seed: int, sheet: Callable[..., Sheet], monkeypatch: pytest.MonkeyPatch
) -> None:
    rng, log = np.random.default_rng(seed), sheet()
    points = mishaps(log.made.points, rng)
    many = track(points, log.made.time, log.robot)
    monkeypatch.setattr(following, "FEWEST_ROWS", 1)
    monkeypatch.setattr(following, "MOST_ROWS", 1)
    one_by_one = track(points, log.made.time, log.robot)
    for name in ("points", "ordered", "exchanged", "partner", "doubtful", "leaps", "rods"):
        np.testing.assert_array_equal(getattr(many, name), getattr(one_by_one, name), name)


def test_a_marker_that_stays_away_for_long_is_masked_until_it_may_have_come_there(
    sheet: Callable[..., Sheet],
) -> None:
    log = sheet()
    points = log.made.points.copy()
    points[50:, :, 0] += 12.0  # all of the robot, so that its rods stay right
    found = track(points, log.made.time, log.robot)
    reach = following.Bounds.of(points, log.robot).reach(log.made.time - log.made.time[49])
    way = np.linalg.norm(points - points[49], axis=-1)
    expected = (np.arange(len(points))[:, None] >= 50) & (way > reach[:, None])
    assert 30 < expected[:, 0].sum() < 150
    np.testing.assert_array_equal(found.leaps, expected)
