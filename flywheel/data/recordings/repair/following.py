"""Assignment of markers to names, row by row.

The meaning of a row depends on the last known positions of the markers. Without swaps, many rows
are decided at once: first assuming that all of them are right, then again without the samples found
to be wrong, until nothing changes.
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
MOST_WOBBLE = 3.0  # standard deviation of a distance, in those of a coordinate; of white noise 1.4
MOST_WRONG = 0.3  # share of a rod: largest tolerance, however noisy the log
WITNESSES = 2  # points of a body from which a third one is at its distances where it belongs
MUCH_BETTER = 0.5  # an exchange must at least halve the leaps
FEWEST_ROWS, MOST_ROWS = 16, 4096  # rows decided at once
ROUGH_ROWS, ROUGH_PIECE = 50_000, 500  # rows, in pieces, from which the noise is taken
PASSES = 8  # over the same rows: while a marker is away, each decides one row more


@dataclass(frozen=True)
class Bounds:
    """Limits on motion and distances of markers.

    Attributes:
      rods: pairs of points at a known distance.
      ends: (rods, P) bool, ends of each rod.
      tolerance: (rods,) of those distances [m].
      noise: of a coordinate, standard deviation [m].
      speed: largest speed of a marker [m/s].
      kick: largest change of its velocity from one row to the next [m/s].
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
        # Differences of differences: what does not move smoothly is noise, of variance 6.
        noise = float(_roughness(points) / np.sqrt(6))
        # Exchanged markers make distances change, but not what is nearest to each.
        wobble = np.minimum(_wobble(points, rods) / np.sqrt(2), MOST_WOBBLE * noise)
        least = np.where(own, LEAST_WRONG, PLACED) * known
        tolerance = np.clip(NOISES * wobble, least, MOST_WRONG * known) + np.abs(usual - known) / 2
        ends = np.zeros((len(rods), points.shape[1]), bool)
        for row, rod in zip(ends, rods, strict=True):
            row[[rod.a, rod.b]] = True
        fall = float(np.sqrt(GRAVITY * robot.length))
        return cls(rods, ends, tolerance, noise, FASTEST * fall, np.sqrt(2) * fall)

    def reach(self, seconds: Floats) -> Floats:
        """Largest possible distance of a marker from its last position [m]."""
        return self.speed * seconds + NOISES * self.noise

    def quick(self, seconds: Floats) -> Floats:
        """Rarely exceeded distance of a marker from its last position [m]."""
        return self.kick * seconds + NOISES * self.noise

    def wrong(self, points: Floats) -> NDArray[np.bool_]:
        """(..., rods) bool: True for wrong distances between points (..., P, 3)."""
        return wrong_rods(points, self.rods, self.tolerance)


class Followed:
    """Markers assigned to their points, row by row.

    Attributes:
      order: (N, P) index of the marker under each point.
      leaps: (N, P) points further away than they can have moved.
      rods: (N, P) points at a wrong distance from another one.
      doubted: (P,) the row from which on a swap of a point is uncertain.
    """

    def __init__(self, rows: int, count: int) -> None:
        self.order = np.empty((rows, count), np.int16)
        self.leaps, self.rods = np.zeros((2, rows, count), bool)
        self.doubted = np.full(count, rows)

    def add(self, row: int, decided: _Rows, points: Floats, bounds: Bounds) -> int:
        """Store decided rows, starting at a row, and return the next one."""
        end = row + len(decided)
        self.order[row:end] = decided.order
        self.leaps[row:end], self.rods[row:end] = decided.leaps, decided.rods
        for both, first in _perhaps_back(points[row:end], decided, bounds):
            self.doubted[both] = np.minimum(self.doubted[both], row + first)
        return end


@dataclass(frozen=True)
class _Seen:
    """State before a row: last position (P, 3) and time (P,) of each point.

    Attributes:
      order: (P,).
      last, when: the last correct sample.
      raw, raw_when: the last sample of all.
      away: (P,) True if that one was a leap.
    """

    order: NDArray[np.int64]
    last: Floats
    when: Floats
    raw: Floats
    raw_when: Floats
    away: NDArray[np.bool_]


BEFORE = ("last", "when", "raw", "raw_when", "away")  # of _Rows: before each row, and after all
EACH = ("now", "reach", "leaps", "rods", "odd")  # of _Rows: in each row


@dataclass(frozen=True)
class _Rows:
    """Rows decided under one order.

    Attributes:
      order: (P,).
      now: (n, P, 3) points in that order.
      last, when: (n + 1, P, ...) where and when each was right last: before each row, and after all.
      raw, raw_when, away: (n + 1, P, ...) the same of all samples, and whether those are leaps.
      reach: (n, P) how far each may have come.
      leaps, rods: (n, P) what is wrong.
      odd: (n, P) what came so far that an exchange is more likely, if there may be one.
    """

    order: NDArray[np.int64]
    now: Floats
    last: Floats
    when: Floats
    raw: Floats
    raw_when: Floats
    away: NDArray[np.bool_]
    reach: Floats
    leaps: NDArray[np.bool_]
    rods: NDArray[np.bool_]
    odd: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.now)

    def first(self, rows: int) -> _Rows:
        """The first rows, up to a number."""
        before = {name: getattr(self, name)[: rows + 1] for name in BEFORE}
        each = {name: getattr(self, name)[:rows] for name in EACH}
        return replace(self, **before, **each)

    def after(self) -> _Seen:
        """The state after them."""
        return _Seen(self.order, *(getattr(self, name)[-1] for name in BEFORE))


def follow(points: Floats, time: Floats, bounds: Bounds) -> Followed:
    """Follow the markers (N, P, 3) [m] through times (N,) [s]."""
    rows, count = points.shape[:2]
    followed = Followed(rows, count)
    nowhere, begin = np.full((count, 3), np.nan), np.full(count, time[0])
    seen = _Seen(np.arange(count), nowhere, begin, nowhere, begin, np.zeros(count, bool))
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
    raw, raw_when = _seen_last(now, time, there, seen.raw, seen.raw_when)
    step = distance(now, raw[:-1])
    steady = step <= bounds.reach(time[:, None] - raw_when[:-1])
    wrong = np.zeros_like(there)
    for _ in range(PASSES):
        last, when = _seen_last(now, time, there & ~wrong, seen.last, seen.when)
        since = time[:, None] - when[:-1]
        reach, way = bounds.reach(since), distance(now, last[:-1])
        leaps = _leaps(there, way > reach, steady & (step <= way), off, seen.away, bounds)
        rods = (off & ~(leaps @ bounds.ends.T)) @ bounds.ends
        changed = np.flatnonzero(((leaps | rods) != wrong).any(axis=1))
        wrong = leaps | rods
        if len(changed) == 0:
            break
    away = np.take_along_axis(np.concatenate([seen.away[None], leaps]), _latest(there), axis=0)
    odd = way > bounds.quick(since)
    decided = _Rows(seen.order, now, last, when, raw, raw_when, away, reach, leaps, rods, odd)
    # In each pass at least one more row is decided, because all before it are.
    return decided.first(int(changed[0])) if len(changed) else decided


def _leaps(
    there: NDArray[np.bool_],
    far: NDArray[np.bool_],
    steady: NDArray[np.bool_],
    off: NDArray[np.bool_],
    before: NDArray[np.bool_],
    bounds: Bounds,
) -> NDArray[np.bool_]:
    """(n, P) bool: True for leaps, until the marker is back where others of its body say that it belongs.

    Args:
      there, far, steady, before: as in `_away`.
      off: (n, rods) wrong distances.
    """
    back = np.zeros_like(there)
    while True:
        leaps = _away(there, far, steady & ~back, before)
        found = leaps & ~far & _confirmed(off, there & ~leaps, bounds)
        rows = np.flatnonzero(found.any(axis=1))
        if len(rows) == 0:
            return leaps
        back[rows[0]] |= found[rows[0]]  # which may change all later rows


def _away(
    there: NDArray[np.bool_],
    far: NDArray[np.bool_],
    steady: NDArray[np.bool_],
    before: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """(n, P) bool: True for leaps: samples too far away, and those that continue from them.

    Time does not rehabilitate a marker that leapt: its new position may be reachable, but was not
    reached.

    Args:
      there: existing samples.
      far: those too far from the last correct one.
      steady: those that continue the previous sample.
      before: (P,) True if the last one before all of them was a leap.
    """
    if not (far.any() or before.any()):
        return far
    begins = _latest(there & ~steady)[1:]  # of the steady part that each sample is in
    return there & np.take_along_axis(np.concatenate([before[None], far]), begins, axis=0)


def _confirmed(
    off: NDArray[np.bool_], still: NDArray[np.bool_], bounds: Bounds
) -> NDArray[np.bool_]:
    """(n, P) bool: True for points that did leap, but are at their distances from others that did not.

    Two of these must say so. A swap with another body's marker, or a place beside it, does not look so.

    Args:
      off: (n, rods) wrong distances.
      still: (n, P) samples that are no leaps.
    """
    witness = still.astype(np.int64) @ bounds.ends.T == 1  # one end leapt, the other one did not
    right, wrong = ((witness & each).astype(np.int64) @ bounds.ends for each in (~off, off))
    return np.asarray(~still & (right >= WITNESSES) & (wrong == 0))


def _latest(which: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(n + 1, P) 1 + the latest true row, before each row and after all; 0 without one."""
    rows = np.where(which, np.arange(1, len(which) + 1)[:, None], 0)
    return np.maximum.accumulate(np.concatenate([np.zeros_like(rows[:1]), rows]), axis=0)


def _seen_last(
    now: Floats, time: Floats, which: NDArray[np.bool_], last: Floats, when: Floats
) -> tuple[Floats, Floats]:
    """(n + 1, P, ...) the latest of some samples: before each row, and after all.

    Args:
      now: (n, P, 3) points.
      time: (n,) of the rows.
      which: (n, P) valid samples.
      last, when: (P, 3), (P,) the latest before all of them.
    """
    index = _latest(which)
    places = np.concatenate([last[None], now])
    times = np.concatenate([[0.0], time])
    found = np.take_along_axis(places, index[..., None], axis=0)
    return found, np.where(index == 0, when, times[index])


def _first_exchange(
    points: Floats, decided: _Rows, bounds: Bounds
) -> tuple[int, NDArray[np.int64] | None]:
    """The first row that is right in another order, and that order; else the number of rows."""
    count = len(decided.order)
    couples = np.array(list(combinations(range(count), 2)), np.int64).reshape(-1, 2)
    orders = np.tile(decided.order, (len(couples), 1))
    np.put_along_axis(orders, couples, decided.order[couples[:, ::-1]], axis=1)
    rows = np.flatnonzero((decided.leaps | decided.rods | decided.odd).any(axis=1))
    for piece in pieces(len(rows), 3 * (orders.size + 2 * count)):
        some = rows[piece]
        tried = np.concatenate(
            [
                np.broadcast_to(orders, (len(some), *orders.shape)),
                _nearest(points[some], decided, some)[:, None],
            ],
            axis=1,
        )
        best = _exchanged(points[some], decided, some, tried, bounds)
        found = np.flatnonzero(best >= 0)
        if len(found):
            return int(some[found[0]]), tried[found[0], best[found[0]]]
    return len(decided), None


def _nearest(points: Floats, decided: _Rows, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n, P) orders of points (n, P, 3) in which each continues its motion, if none is used twice.

    A missing point, or one that never was right, keeps its marker.
    """
    last, order = decided.last[rows], decided.order
    known = np.isfinite(last[..., 0]) & np.isfinite(decided.now[rows][..., 0])
    way = distance(points[:, None], last[:, :, None])
    markers = np.zeros_like(known)
    markers[:, order] = known
    way[~(known[:, :, None] & markers[:, None])] = np.inf
    found = np.where(known, way.argmin(axis=2), order)
    once = (np.sort(found, axis=1) == np.arange(len(order))).all(axis=1)
    return np.where(once[:, None], found, order)


def _exchanged(
    points: Floats,
    decided: _Rows,
    rows: NDArray[np.int64],
    orders: NDArray[np.int64],
    bounds: Bounds,
) -> NDArray[np.int64]:
    """(n,) index of the order in (n, C, P) that makes points (n, P, 3) right; -1 without one.

    Args:
      points: of some rows.
      decided: all rows.
      rows: (n,) their indices.
      orders: to try in each row.
      bounds: limits.
    """
    last, reach = decided.last[rows], decided.reach[rows]
    least = MUCH_BETTER * np.nansum(distance(decided.now[rows], last), axis=-1)
    other = orders != decided.order
    tried = points[np.arange(len(rows))[:, None, None], orders]
    way = distance(tried, last[:, None])
    total = np.nansum(way, axis=-1)
    near = (way <= reach[:, None]) | ~other
    touching = (other @ bounds.ends.T) > 0
    right = ~(bounds.wrong(tried) & touching).any(axis=-1)
    good = other.any(axis=-1) & near.all(axis=-1) & right & (total < least[:, None])
    return np.where(good.any(axis=1), np.where(good, total, np.inf).argmin(axis=1), -1)


def _perhaps_back(
    points: Floats, decided: _Rows, bounds: Bounds
) -> Iterator[tuple[NDArray[np.int64], int]]:
    """Swapped points that may have other names again: their indices, and the first such row."""
    for back in _undone(decided.order):
        them = np.flatnonzero(back != decided.order)
        last, reach = decided.last[:-1, them], decided.reach[:, them]
        wrong = (decided.leaps | decided.rods)[:, them, None]
        way = distance(np.where(wrong, np.nan, decided.now[:, them]), last)
        instead = distance(points[:, back[them]], last)
        possible = ((instead <= reach) | np.isnan(instead)).all(axis=1)
        as_good = MUCH_BETTER * np.nansum(instead, axis=1) < np.nansum(way, axis=1)
        touching = bounds.ends[:, them].any(axis=1)
        right = ~(bounds.wrong(points[:, back]) & touching).any(axis=1)
        found = np.flatnonzero(possible & as_good & right)
        if len(found):
            yield them, int(found[0])


def _undone(order: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Orders in which one of the swapped points has its own marker again, or all have."""
    away = np.flatnonzero(order != np.arange(len(order)))
    found = [np.arange(len(order))] if len(away) else []
    for point in away:
        back = order.copy()
        both = [point, np.flatnonzero(order == point)[0]]
        back[both] = order[both[::-1]]
        found.append(back)
    return found


def _wobble(points: Floats, rods: list[Pair]) -> Floats:
    """(rods,) robust standard deviation of a distance's change from row to row [m]."""
    changes = [median(np.abs(np.diff(distances(points, [rod])[:, 0]))) for rod in rods]
    return np.nan_to_num(1.4826 * np.array(changes))


def _roughness(points: Floats) -> float:
    """Robust standard deviation of noise, from a coordinate's second differences [m].

    By quantiles, so that it is the same if most rows only interpolate others; and of nearest
    points, so that it is independent of their names.
    """
    seen = points[np.isfinite(points[..., 0]).any(axis=1)]
    rough = [np.zeros(0)]
    step = max(1, len(seen) // ROUGH_ROWS)
    for begin in range(0, len(seen) - 2, ROUGH_PIECE * step):
        some = seen[begin : begin + ROUGH_PIECE]
        ahead, behind = _same(some[:-1], some[1:]), _same(some[1:], some[:-1])
        before = np.take_along_axis(some[:-2], np.maximum(behind[:-1], 0)[..., None], axis=1)
        after = np.take_along_axis(some[2:], np.maximum(ahead[1:], 0)[..., None], axis=1)
        both = (behind[:-1] >= 0) & (ahead[1:] >= 0)
        rough.append(np.abs(before - 2 * some[1:-1] + after)[both].ravel())
    found = np.concatenate(rough)
    if len(found) == 0:
        return 0.0
    half, most = np.quantile(found, [0.5, 0.9], overwrite_input=True)
    return float(max(1.4826 * half, most / 1.645))


def _same(points: Floats, others: Floats) -> NDArray[np.int64]:
    """(n, P) index of the nearest of the others (n, P, 3) for each of the points (n, P, 3); -1: none.

    Two names may only be swapped if both are in both.
    """
    way = distance(points[:, :, None], others[:, None])
    way[np.isnan(way)] = np.inf
    ahead, back = way.argmin(axis=2), way.argmin(axis=1)
    own = np.arange(points.shape[1])
    mutual = np.take_along_axis(back, ahead, axis=1) == own
    there = np.isfinite(points[..., 0]) & np.isfinite(others[..., 0])
    known = there & np.take_along_axis(there, ahead, axis=1)
    return np.where(mutual & known, ahead, -1)
