"""Which marker is under which name, row after row.

What a row says depends on where each marker was last seen before it. As long as no two markers are
exchanged, many rows are decided at once: first as if all of them were right, then again with what was
found wrong left out, until nothing changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.geometry import (
    Pair,
    distances,
    median,
    pairs,
    usual_distances,
    wrong_rods,
)
from flywheel.data.recordings.pieces import distance, pieces
from flywheel.records import Floats
from flywheel.robots import GRAVITY, Robot

FASTEST = 3.0  # in speeds of a fall from L: no marker is faster
NOISES = 8.0  # standard deviations beyond which it is not noise
PLACED = 0.05  # share of a rod: tolerance of marker placement against the MJCF
LEAST_WRONG = 0.02  # share of a rod's usual length in the log
MOST_WRONG = 0.3  # share of a rod: largest tolerance, however noisy the log
MUCH_BETTER = 0.5  # an exchange must at least halve the leaps
FEWEST_ROWS, MOST_ROWS = 16, 4096  # rows decided at once
PASSES = 8  # over the same rows: while a marker is away, each decides one row more


@dataclass(frozen=True)
class Bounds:
    """Limits on how markers can move and lie.

    Attributes:
      rods: pairs of points at a known distance.
      ends: (rods, P) which points each of them is between.
      tolerance: (rods,) of those distances [m].
      noise: of a coordinate, standard deviation [m].
      speed: of a marker at most [m/s].
      kick: change of its velocity from one row to the next at most [m/s].
    """

    rods: list[Pair]
    ends: NDArray[np.bool_]
    tolerance: Floats
    noise: float
    speed: float
    kick: float

    @classmethod
    def of(cls, points: Floats, robot: Robot) -> Bounds:
        """Bounds from the robot's size and the noise of the points (N, P, 3)."""
        rods = pairs(robot)
        known = np.array([rod.distance for rod in rods])
        usual = usual_distances(points, rods)
        own = np.abs(usual / known - 1) <= PLACED if rods else np.zeros(0, bool)
        usual = np.where(own, usual, known)
        # Right is what the MJCF says, what the log usually has, and what lies between.
        rods = [
            replace(rod, distance=(rod.distance + float(got)) / 2)
            for rod, got in zip(rods, usual, strict=True)
        ]
        wobble = _wobble(points, rods) / np.sqrt(2)
        least = np.where(own, LEAST_WRONG, PLACED) * known
        tolerance = np.clip(NOISES * wobble, least, MOST_WRONG * known) + np.abs(usual - known) / 2
        ends = np.zeros((len(rods), points.shape[1]), bool)
        for row, rod in zip(ends, rods, strict=True):
            row[[rod.a, rod.b]] = True
        # Differences of differences: what does not move smoothly is noise, of variance 6.
        noise = float(_roughness(points) / np.sqrt(6))
        fall = float(np.sqrt(GRAVITY * robot.length))
        return cls(rods, ends, tolerance, noise, FASTEST * fall, np.sqrt(2) * fall)

    def reach(self, seconds: Floats) -> Floats:
        """How far a marker may have come [m]."""
        return self.speed * seconds + NOISES * self.noise

    def wrong(self, points: Floats) -> NDArray[np.bool_]:
        """(..., rods) which distances of points (..., P, 3) are wrong."""
        return wrong_rods(points, self.rods, self.tolerance)


class Followed:
    """Markers assigned to their points, row by row.

    Attributes:
      order: (N, P) the marker that each point is under.
      leaps: (N, P) points further away than they can have come.
      rods: (N, P) points at a wrong distance from another one.
      doubted: (P,) the row from which on nobody knows whether a point is still exchanged.
    """

    def __init__(self, rows: int, count: int) -> None:
        self.order = np.empty((rows, count), np.int16)
        self.leaps, self.rods = np.zeros((2, rows, count), bool)
        self.doubted = np.full(count, rows)

    def add(self, row: int, decided: _Rows, points: Floats, bounds: Bounds) -> int:
        """Take over rows that were decided, from a row on, and say which is the next."""
        end = row + len(decided)
        self.order[row:end] = decided.order
        self.leaps[row:end], self.rods[row:end] = decided.leaps, decided.rods
        for both, first in _perhaps_back(points[row:end], decided, bounds):
            self.doubted[both] = np.minimum(self.doubted[both], row + first)
        return end


@dataclass(frozen=True)
class _Seen:
    """Before a row: the order (P,), and where (P, 3) and when (P,) each point was seen last."""

    order: NDArray[np.int64]
    last: Floats
    when: Floats


@dataclass(frozen=True)
class _Rows:
    """Rows that were decided under one order.

    Attributes:
      order: (P,).
      now: (n, P, 3) points in that order.
      last, when: (n + 1, P, ...) where and when each was seen last: before each row, and after all.
      reach: (n, P) how far each may have come.
      leaps, rods: (n, P) what is wrong.
    """

    order: NDArray[np.int64]
    now: Floats
    last: Floats
    when: Floats
    reach: Floats
    leaps: NDArray[np.bool_]
    rods: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.now)

    def first(self, rows: int) -> _Rows:
        """The first rows, that many."""
        return _Rows(
            self.order,
            self.now[:rows],
            self.last[: rows + 1],
            self.when[: rows + 1],
            self.reach[:rows],
            self.leaps[:rows],
            self.rods[:rows],
        )

    def after(self) -> _Seen:
        """What is known after them."""
        return _Seen(self.order, self.last[-1], self.when[-1])


def follow(points: Floats, time: Floats, bounds: Bounds) -> Followed:
    """Follow the markers (N, P, 3) [m] through times (N,) [s]."""
    rows, count = points.shape[:2]
    followed = Followed(rows, count)
    seen = _Seen(np.arange(count), np.full((count, 3), np.nan), np.full(count, time[0]))
    row, size = 0, FEWEST_ROWS
    while row < rows:
        some = slice(row, row + size)
        decided = _decided(points[some], time[some], seen, bounds)
        kept, order = _first_exchange(points[some], decided, bounds)
        size = min(2 * size, MOST_ROWS) if kept == size else max(size // 2, FEWEST_ROWS)
        decided = decided.first(kept)
        row, seen = followed.add(row, decided, points, bounds), decided.after()
        if order is not None:
            one = slice(row, row + 1)
            decided = _decided(points[one], time[one], replace(seen, order=order), bounds)
            row, seen = followed.add(row, decided, points, bounds), decided.after()
    return followed


def _decided(points: Floats, time: Floats, seen: _Seen, bounds: Bounds) -> _Rows:
    """Rows (n, P, 3) under the order known before them: all, or the first of them."""
    now = points[:, seen.order]
    there, off = np.isfinite(now[..., 0]), bounds.wrong(now)
    wrong = np.zeros_like(there)
    for _ in range(PASSES):
        last, when = _seen_last(now, time, there & ~wrong, seen)
        reach = bounds.reach(time[:, None] - when[:-1])
        leaps = distance(now, last[:-1]) > reach
        rods = (off & ~(leaps @ bounds.ends.T)) @ bounds.ends
        changed = np.flatnonzero(((leaps | rods) != wrong).any(axis=1))
        wrong = leaps | rods
        if len(changed) == 0:
            break
    # In each pass at least one more row is decided, because all before it are.
    decided = _Rows(seen.order, now, last, when, reach, leaps, rods)
    return decided.first(int(changed[0])) if len(changed) else decided


def _seen_last(
    now: Floats, time: Floats, well: NDArray[np.bool_], seen: _Seen
) -> tuple[Floats, Floats]:
    """(n + 1, P, ...) where and when each point was last seen well: before each row, and after all."""
    rows, count = well.shape
    index = np.zeros((rows + 1, count), np.int64)  # 0: before all of them
    index[1:] = np.maximum.accumulate(np.where(well, np.arange(1, rows + 1)[:, None], 0), axis=0)
    places = np.concatenate([seen.last[None], now])
    times = np.concatenate([[0.0], time])
    last = np.take_along_axis(places, index[..., None], axis=0)
    return last, np.where(index == 0, seen.when, times[index])


def _first_exchange(
    points: Floats, decided: _Rows, bounds: Bounds
) -> tuple[int, NDArray[np.int64] | None]:
    """The first row that is right in another order, and that order; else the number of rows."""
    count = len(decided.order)
    couples = np.array(list(combinations(range(count), 2)), np.int64).reshape(-1, 2)
    orders = np.tile(decided.order, (len(couples), 1))
    np.put_along_axis(orders, couples, decided.order[couples[:, ::-1]], axis=1)
    rows = np.flatnonzero((decided.leaps | decided.rods).any(axis=1))
    for piece in pieces(len(rows), 3 * orders.size):
        some = rows[piece]
        best = _exchanged(points[some], decided, some, couples, orders, bounds)
        found = np.flatnonzero(best >= 0)
        if len(found):
            return int(some[found[0]]), orders[best[found[0]]]
    return len(decided), None


def _exchanged(
    points: Floats,
    decided: _Rows,
    rows: NDArray[np.int64],
    couples: NDArray[np.int64],
    orders: NDArray[np.int64],
    bounds: Bounds,
) -> NDArray[np.int64]:
    """(n,) which of the couples (C, 2) makes points (n, P, 3) right when exchanged; -1 where none does.

    Args:
      points: of some rows.
      decided: all rows.
      rows: (n,) which they are.
      couples: pairs of points.
      orders: (C, P) with each of them exchanged.
      bounds: what is possible.
    """
    last, reach = decided.last[rows], decided.reach[rows]
    least = MUCH_BETTER * np.nansum(distance(decided.now[rows], last), axis=-1)
    tried = points[:, orders]
    way = distance(tried, last[:, None])
    total = np.nansum(way, axis=-1)
    near = way[:, np.arange(len(couples))[:, None], couples] <= reach[:, couples]
    touching = bounds.ends.T[couples].any(axis=1)
    right = ~(bounds.wrong(tried) & touching).any(axis=-1)
    good = near.all(axis=-1) & right & (total < least[:, None])
    return np.where(good.any(axis=1), np.where(good, total, np.inf).argmin(axis=1), -1)


def _perhaps_back(
    points: Floats, decided: _Rows, bounds: Bounds
) -> Iterator[tuple[NDArray[np.int64], int]]:
    """Exchanged points that may as well have their own names again: both, and the first such row."""
    order, last, reach = decided.order, decided.last[:-1], decided.reach
    for point in np.flatnonzero(order != np.arange(len(order))):
        both = np.array([point, np.flatnonzero(order == point)[0]])
        back = order.copy()
        back[both] = order[both[::-1]]
        taken = np.where(
            (decided.leaps | decided.rods)[:, both, None], np.nan, decided.now[:, both]
        )
        way, instead = (
            distance(taken, last[:, both]),
            distance(points[:, back[both]], last[:, both]),
        )
        possible = ((instead <= reach[:, both]) | np.isnan(instead)).all(axis=1)
        as_good = MUCH_BETTER * np.nansum(instead, axis=1) < np.nansum(way, axis=1)
        touching = bounds.ends[:, both].any(axis=1)
        right = ~(bounds.wrong(points[:, back]) & touching).any(axis=1)
        found = np.flatnonzero(possible & as_good & right)
        if len(found):
            yield both, int(found[0])


def _wobble(points: Floats, rods: list[Pair]) -> Floats:
    """(rods,) standard deviation of a distance's change from row to row, unmoved by outliers [m]."""
    changes = [median(np.abs(np.diff(distances(points, [rod])[:, 0]))) for rod in rods]
    return np.nan_to_num(1.4826 * np.array(changes))


def _roughness(points: Floats) -> float:
    """Standard deviation of what does not move smoothly, of a coordinate's second differences [m].

    By quantiles, so that it is the same where most rows only repeat or interpolate others.
    """
    found, count = np.empty(points.size), 0
    for some in pieces(len(points) - 2, points[0].size):
        rough = np.diff(points[some.start : some.stop + 2], n=2, axis=0)
        rough = np.abs(rough[np.isfinite(rough)])
        found[count : count + len(rough)] = rough
        count += len(rough)
    if count == 0:
        return 0.0
    half, most = np.quantile(found[:count], [0.5, 0.9], overwrite_input=True)
    return float(max(1.4826 * half, most / 1.645))
