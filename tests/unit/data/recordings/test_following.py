"""Many rows are decided at once as they would be one after the other."""

from collections.abc import Callable, Iterator
from itertools import combinations

import numpy as np
import pytest

from flywheel.data.recordings.pieces import distance
from flywheel.data.recordings.repair.following import MUCH_BETTER, Bounds, follow
from flywheel.data.recordings.repair.markers import track
from tests.unit.data.recordings.conftest import Sheet


def mishaps(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points (N, P, 3) with markers exchanged, lost, leaping, left behind and frozen."""
    points, (rows, count) = points.copy(), points.shape[:2]
    for _ in range(rng.integers(2, 14)):
        begin = int(rng.integers(0, rows))
        end = begin + int(rng.integers(1, 60))
        one, two = rng.choice(count, 2, replace=False)
        what = rng.integers(7)
        if what == 0:
            points[begin:end, [one, two]] = points[begin:end, [two, one]]
        elif what == 5:
            some = rng.choice(count, 3, replace=False)
            points[begin:end, some] = points[begin:end, np.roll(some, 1)]
        elif what == 6 and count > 4:
            points[begin:end, :4] = points[begin:end, [2, 3, 0, 1]]
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
    """What `follow` does, in plain words: one row, one order and one marker after the other."""

    def __init__(self, points: np.ndarray, time: np.ndarray, bounds: Bounds) -> None:
        self.bounds, count = bounds, points.shape[1]
        self.order, self.last = np.arange(count), np.full((count, 3), np.nan)
        self.when = np.full(count, time[0])
        self.raw, self.raw_when = self.last.copy(), self.when.copy()
        self.away = np.zeros(count, bool)
        orders, leaps, rods = [], [], []
        self.doubted = np.full(count, len(points))
        for t, (measured, now) in enumerate(zip(points, time, strict=True)):
            reach = bounds.reach(now - self.when)
            far, wrong = self.judged(measured[self.order], reach, now)
            odd = distance(measured[self.order], self.last) > bounds.quick(now - self.when)
            if (far | wrong | odd).any():
                self.order = self.exchanged(measured, reach)
                far, wrong = self.judged(measured[self.order], reach, now)
            ours = measured[self.order]
            taken = np.where((far | wrong)[:, None], np.nan, ours)
            self.doubt(t, taken, measured, reach)
            seen, right = np.isfinite(ours[:, 0]), np.isfinite(taken[:, 0])
            self.last[right], self.when[right] = taken[right], now
            self.raw[seen], self.raw_when[seen], self.away[seen] = ours[seen], now, far[seen]
            for kept, found in ((orders, self.order), (leaps, far), (rods, wrong)):
                kept.append(found)
        self.orders, self.leaps, self.rods = map(np.array, (orders, leaps, rods))

    def judged(
        self, points: np.ndarray, reach: np.ndarray, now: float
    ) -> tuple[np.ndarray, np.ndarray]:
        way, step = distance(points, self.last), distance(points, self.raw)
        steady = (step <= self.bounds.reach(now - self.raw_when)) & (step <= way)
        far = np.where(steady, self.away, way > reach)
        while (back := self.back(points, far, way <= reach)).any():
            far = far & ~back
        wrong = self.bounds.wrong(np.where(far[:, None], np.nan, points))
        return far, np.array([wrong[ends].any() for ends in self.bounds.ends.T])

    def back(self, points: np.ndarray, far: np.ndarray, near: np.ndarray) -> np.ndarray:
        found, still = np.zeros(len(far), bool), np.isfinite(points[:, 0]) & ~far
        wrong = self.bounds.wrong(points)
        for point in np.flatnonzero(far & near):
            seen_from = [
                wrong[rod]
                for rod, ends in enumerate(self.bounds.ends)
                if ends[point] and (ends & still).any()
            ]
            found[point] = len(seen_from) >= 2 and not any(seen_from)
        return found

    def right(self, points: np.ndarray, changed: np.ndarray) -> bool:
        touching = self.bounds.ends[:, changed].any(axis=1)
        return not self.bounds.wrong(points)[touching].any()

    def candidates(self, measured: np.ndarray) -> Iterator[np.ndarray]:
        for a, b in combinations(range(len(self.order)), 2):
            tried = self.order.copy()
            tried[[a, b]] = tried[[b, a]]
            yield tried
        nearest = self.order.copy()
        known = np.isfinite(self.last[:, 0]) & np.isfinite(measured[self.order][:, 0])
        markers = self.order[known]
        for point in np.flatnonzero(known):
            nearest[point] = markers[distance(measured[markers], self.last[point]).argmin()]
        if len(set(nearest.tolist())) == len(nearest):
            yield nearest

    def exchanged(self, measured: np.ndarray, reach: np.ndarray) -> np.ndarray:
        best = self.order
        least = MUCH_BETTER * np.nansum(distance(measured[best], self.last))
        for tried in self.candidates(measured):
            changed = np.flatnonzero(tried != self.order)
            way = distance(measured[tried], self.last)
            near = (way[changed] <= reach[changed]).all() and len(changed) > 0
            if near and self.right(measured[tried], changed) and np.nansum(way) < least:
                best, least = tried, np.nansum(way)
        return best

    def doubt(self, t: int, taken: np.ndarray, measured: np.ndarray, reach: np.ndarray) -> None:
        own = np.arange(len(self.order))
        others = [own] if (self.order != own).any() else []
        for a in np.flatnonzero(self.order != own):
            both = [a, int(np.flatnonzero(self.order == a)[0])]
            others.append(self.order.copy())
            others[-1][both] = self.order[both[::-1]]
        for back in others:
            changed = np.flatnonzero(back != self.order)
            way = distance(taken, self.last)[changed]
            instead = distance(measured[back], self.last)[changed]
            possible = ((instead <= reach[changed]) | np.isnan(instead)).all()
            as_good = MUCH_BETTER * np.nansum(instead) < np.nansum(way)
            if possible and as_good and self.right(measured[back], changed):
                self.doubted[changed] = np.minimum(self.doubted[changed], t)


@pytest.mark.parametrize("seed", range(24))
def test_many_rows_at_once_are_decided_as_one_after_the_other(seed, sheet):
    rng, log = np.random.default_rng(seed), sheet("platform4" if seed % 4 == 0 else "prism3")
    points, time = mishaps(log.made.points, rng), log.made.time
    bounds = Bounds.of(points, log.robot)
    many, single = follow(points, time, bounds), RowByRow(points, time, bounds)
    np.testing.assert_array_equal(many.order, single.orders)
    np.testing.assert_array_equal(many.leaps, single.leaps)
    np.testing.assert_array_equal(many.rods, single.rods)
    np.testing.assert_array_equal(many.doubted, single.doubted)


def test_a_leap_is_not_believed_because_time_goes_by(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    points = log.made.points.copy()
    points[50:150, :, 0] += 2.0  # all of the robot, so that its rods stay right
    found = track(points, log.made.time, log.robot)
    expected = (np.arange(len(points)) >= 50) & (np.arange(len(points)) < 150)
    np.testing.assert_array_equal(found.leaps, np.repeat(expected[:, None], 6, axis=1))


def test_a_marker_that_comes_back_in_small_steps_is_believed_for_its_distances(sheet):
    """From two others of its body that did not leap."""
    log = sheet("platform4")
    points, reach = log.made.true_points.copy(), Bounds.of(log.made.points, log.robot).reach(0.01)
    points[50:80, 1, 1] += 1.3 * reach * 0.6 ** np.arange(30)
    found = track(points, log.made.time, log.robot)
    gone = np.flatnonzero(found.leaps[:, 1] | found.rods[:, 1])
    assert gone[0] == 50 and gone[-1] < 60
