"""Many rows are decided at once as they would be one after the other."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest

from flywheel.data.recordings.following import MUCH_BETTER, Bounds, follow
from flywheel.data.recordings.markers import track
from flywheel.data.recordings.pieces import distance
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


class RowByRow:
    """What `follow` does, in plain words: one row, one pair and one marker after the other."""

    def __init__(self, points: np.ndarray, time: np.ndarray, bounds: Bounds) -> None:
        self.bounds, count = bounds, points.shape[1]
        self.order, self.last = np.arange(count), np.full((count, 3), np.nan)
        self.when = np.full(count, time[0])
        orders, leaps, rods = [], [], []
        self.doubted = np.full(count, len(points))
        for t, (measured, now) in enumerate(zip(points, time, strict=True)):
            reach = bounds.reach(now - self.when)
            far, wrong = self.judged(measured[self.order], reach)
            if (far | wrong).any():
                self.order = self.exchanged(measured, reach)
                far, wrong = self.judged(measured[self.order], reach)
            taken = np.where((far | wrong)[:, None], np.nan, measured[self.order])
            self.doubt(t, taken, measured, reach)
            seen = np.isfinite(taken[:, 0])
            self.last[seen], self.when[seen] = taken[seen], now
            for kept, found in ((orders, self.order), (leaps, far), (rods, wrong)):
                kept.append(found)
        self.orders, self.leaps, self.rods = map(np.array, (orders, leaps, rods))

    def judged(self, points: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        far = distance(points, self.last) > reach
        wrong = self.bounds.wrong(np.where(far[:, None], np.nan, points))
        return far, np.array([wrong[ends].any() for ends in self.bounds.ends.T])

    def right(self, points: np.ndarray, a: int, b: int) -> bool:
        touching = self.bounds.ends[:, a] | self.bounds.ends[:, b]
        return not self.bounds.wrong(points)[touching].any()

    def exchanged(self, measured: np.ndarray, reach: np.ndarray) -> np.ndarray:
        best = self.order
        least = MUCH_BETTER * np.nansum(distance(measured[best], self.last))
        for a, b in combinations(range(len(best)), 2):
            tried = self.order.copy()
            tried[[a, b]] = tried[[b, a]]
            way = distance(measured[tried], self.last)
            near = way[a] <= reach[a] and way[b] <= reach[b]
            if near and self.right(measured[tried], a, b) and np.nansum(way) < least:
                best, least = tried, np.nansum(way)
        return best

    def doubt(self, t: int, taken: np.ndarray, measured: np.ndarray, reach: np.ndarray) -> None:
        for a in np.flatnonzero(self.order != np.arange(len(self.order))):
            both = [a, int(np.flatnonzero(self.order == a)[0])]
            back = self.order.copy()
            back[both] = self.order[both[::-1]]
            way = distance(taken, self.last)[both]
            instead = distance(measured[back], self.last)[both]
            possible = ((instead <= reach[both]) | np.isnan(instead)).all()
            as_good = MUCH_BETTER * np.nansum(instead) < np.nansum(way)
            if possible and as_good and self.right(measured[back], *both):
                self.doubted[both] = np.minimum(self.doubted[both], t)


@pytest.mark.parametrize("seed", range(24))
def test_many_rows_at_once_are_decided_as_one_after_the_other(
    seed: int, sheet: Callable[..., Sheet]
) -> None:
    rng, log = np.random.default_rng(seed), sheet("platform4" if seed % 4 == 0 else "prism3")
    points, time = mishaps(log.made.points, rng), log.made.time
    bounds = Bounds.of(points, log.robot)
    many, single = follow(points, time, bounds), RowByRow(points, time, bounds)
    np.testing.assert_array_equal(many.order, single.orders)
    np.testing.assert_array_equal(many.leaps, single.leaps)
    np.testing.assert_array_equal(many.rods, single.rods)
    np.testing.assert_array_equal(many.doubted, single.doubted)


def test_a_marker_that_stays_away_for_long_is_masked_until_it_may_have_come_there(
    sheet: Callable[..., Sheet],
) -> None:
    log = sheet()
    points = log.made.points.copy()
    points[50:, :, 0] += 12.0  # all of the robot, so that its rods stay right
    found = track(points, log.made.time, log.robot)
    reach = Bounds.of(points, log.robot).reach(log.made.time - log.made.time[49])
    way = np.linalg.norm(points - points[49], axis=-1)
    expected = (np.arange(len(points))[:, None] >= 50) & (way > reach[:, None])
    assert 30 < expected[:, 0].sum() < 150
    np.testing.assert_array_equal(found.leaps, expected)
