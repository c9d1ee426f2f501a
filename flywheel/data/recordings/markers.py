"""Markers that were taken for each other, and markers that leap.

A marker moves little between two rows, and the markers of a body keep their distance. Where one of
both does not hold, either two markers were exchanged (then exchanging them back puts both right), or
a marker is somewhere else than it should be. A row at a time, so that an exchange that lasts is
found where it begins and where it ends. Where markers that were exchanged come back from a time
unseen so that either may be either, both are given up: a missing sample is honest, a wrong one is not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.geometry import Pair, distances, medians, pairs, wrong_rods
from flywheel.data.recordings.report import Finding
from flywheel.data.recordings.strays import islands, spikes
from flywheel.records import Floats
from flywheel.robots import Robot

GRAVITY = 9.81
FASTEST = 3.0  # times the speed of a fall from L: no marker is faster
NOISES = 8.0  # standard deviations that are no noise any more
PLACED = 0.05  # of a rod: as much may markers be placed elsewhere than in the MJCF
LEAST_WRONG = 0.02  # of a rod as the log usually has it
MOST_WRONG = 0.3  # of a rod: however noisy
MUCH_BETTER = 0.5  # an exchange must at least halve the leaps


@dataclass(frozen=True)
class Tracked:
    """Points after a look at their motion.

    Attributes:
      points: (N, P, 3), exchanged markers put right, wrong samples NaN [m].
      ordered: (N, P, 3) the same with the wrong samples [m].
      exchanged: (N, P) samples that were under another marker's name.
      partner: (N, P) whose name it was.
      doubtful: (N, P) samples of which nobody knows whether they still were.
      leaps: (N, P) samples masked because the marker leapt.
      rods: (N, P) samples masked because a distance was wrong.
    """

    points: Floats
    ordered: Floats
    exchanged: NDArray[np.bool_]
    partner: NDArray[np.int64]
    doubtful: NDArray[np.bool_]
    leaps: NDArray[np.bool_]
    rods: NDArray[np.bool_]


@dataclass(frozen=True)
class Bounds:
    """What is possible.

    Attributes:
      rods: pairs of points at a known distance.
      tolerance: (rods,) of those distances [m].
      noise: of a coordinate, standard deviation [m].
      speed: of a marker at most [m/s].
      kick: change of its velocity from one row to the next at most [m/s].
    """

    rods: list[Pair]
    tolerance: Floats
    noise: float
    speed: float
    kick: float

    @classmethod
    def of(cls, points: Floats, robot: Robot) -> Bounds:
        """From the robot's size, and from the noise that the points (N, P, 3) have."""
        rods = pairs(robot)
        known = np.array([rod.distance for rod in rods])
        usual = medians(distances(points, rods))
        own = np.abs(usual / known - 1) <= PLACED if rods else np.zeros(0, bool)
        usual = np.where(own, usual, known)
        # Right is what the MJCF says, what the log usually has, and what lies between.
        rods = [
            replace(rod, distance=(rod.distance + float(got)) / 2)
            for rod, got in zip(rods, usual, strict=True)
        ]
        # Differences of differences: what does not move smoothly is noise, of variance 6.
        noise = _roughness(np.diff(points, n=2, axis=0)) / np.sqrt(6)
        wobble = _spread(np.diff(distances(points, rods), axis=0)) / np.sqrt(2)
        least = np.where(own, LEAST_WRONG, PLACED) * known
        tolerance = np.clip(NOISES * wobble, least, MOST_WRONG * known) + np.abs(usual - known) / 2
        fall = float(np.sqrt(GRAVITY * robot.length))
        return cls(rods, tolerance, float(noise), FASTEST * fall, np.sqrt(2) * fall)

    def reach(self, seconds: Floats) -> Floats:
        """How far a marker may have come [m]."""
        return self.speed * seconds + NOISES * self.noise

    def right(self, points: Floats) -> bool:
        """No distance of points (P, 3) is wrong."""
        return not wrong_rods(points, self.rods, self.tolerance).any()


def track(points: Floats, time: Floats, robot: Robot) -> Tracked:
    """Follow the markers (N, P, 3) [m] through times (N,) [s]."""
    bounds = Bounds.of(points, robot)
    rows, count = points.shape[:2]
    order = np.arange(count)  # the marker that each point is under now
    last, when = np.full((count, 3), np.nan), np.full(count, time[0])
    orders = np.empty((rows, count), np.int64)
    leaps, rods, doubtful = np.zeros((3, rows, count), bool)
    for t in range(rows):
        now, reach = points[t, order], bounds.reach(time[t] - when)
        far = _moved(now, last) > reach
        if far.any() or not bounds.right(now):
            order = _exchanged(order, points[t], last, reach, bounds)
            now = points[t, order]
            leaps[t] = _moved(now, last) > reach
            now[leaps[t]] = np.nan
            for rod in np.flatnonzero(wrong_rods(now, bounds.rods, bounds.tolerance)):
                rods[t, [bounds.rods[rod].a, bounds.rods[rod].b]] = True
            now[rods[t]] = np.nan
        orders[t] = order
        doubtful[t:] |= _perhaps_back(order, now, points[t], last, reach, bounds)
        seen = np.isfinite(now).all(axis=-1)
        last[seen], when[seen] = now[seen], time[t]
    ordered = np.take_along_axis(points, orders[..., None], axis=1)
    found, leaps, rods = _without_strays(ordered, leaps, rods, time, bounds)
    seen_well = np.isfinite(found).all(axis=-1)
    exchanged = (orders != np.arange(count)) & seen_well & ~doubtful
    return Tracked(found, ordered, exchanged, orders, doubtful & seen_well, leaps, rods)


def _without_strays(
    ordered: Floats,
    leaps: NDArray[np.bool_],
    rods: NDArray[np.bool_],
    time: Floats,
    bounds: Bounds,
) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
    """The points, and what is masked as a leap or by a rod, after a look before and after each row."""
    # The line between two neighbours has half their variance.
    noise = NOISES * bounds.noise * np.sqrt(1.5)
    # A sample within reach from before, from where the next is not, though that one is from before:
    first = spikes(ordered, time, bounds.kick, noise)[:-1] & ~leaps[:-1] & ~rods[:-1] & leaps[1:]
    past = _moved(ordered[2:], ordered[:-2]) <= bounds.reach((time[2:] - time[:-2])[:, None])
    first[0] = False
    first[1:] &= past
    leaps = leaps.copy()
    leaps[:-1] |= first
    leaps[1:] &= ~first
    found = np.where((leaps | rods)[..., None], np.nan, ordered)
    moved, steps = _moved(ordered[1:], ordered[:-1]), np.diff(time)[:, None]
    seen = np.asarray(np.isfinite(found).all(axis=-1))
    chance = islands(leaps | rods, seen, moved <= bounds.reach(steps), time)
    by_rod = chance & rods.any(axis=0)
    found[chance] = np.nan
    leaps = leaps | (chance & ~by_rod) | spikes(found, time, bounds.kick, noise)
    found[leaps] = np.nan
    return found, leaps, rods | by_rod


def judged(
    tracked: Tracked, robot: Robot, time: Floats, repair: bool
) -> tuple[Floats, list[Finding]]:
    """The points (N, P, 3) as they may be used, and what was done to them.

    Args:
      repair: keep exchanged markers, put right, where it is sure which is which; else mask them.
    """
    names = [point.name for point in robot.points]
    findings = []
    points = tracked.points.copy()
    for a, b in combinations(range(len(names)), 2):
        between = tracked.partner[:, a] == b
        where = (tracked.exchanged[:, a] | tracked.exchanged[:, b]) & between
        if where.any():
            words = (
                "put right; to mask them instead, write repair: [] in the map"
                if repair
                else "exchanged, and not put right, as the map says"
            )
            action = "repaired" if repair else "masked"
            pair = f"{names[a]} and {names[b]}"
            findings.append(Finding.over("swap", action, pair, where, time, words))  # type: ignore[arg-type]
    if not repair:
        points[tracked.exchanged] = np.nan
    points[tracked.doubtful] = np.nan
    for kind, masks, words in (
        ("swap", tracked.doubtful, "exchanged, then unseen: which is which can no longer be told"),
        ("leap", tracked.leaps, "further away than it can have come"),
        ("rod length", tracked.rods, "not at its distance from the body's other markers"),
    ):
        for index in np.flatnonzero(masks.any(axis=0)):
            where = masks[:, index]
            findings.append(Finding.over(kind, "masked", names[index], where, time, words))
    return points, findings


def _exchanged(
    order: NDArray[np.int64], measured: Floats, last: Floats, reach: Floats, bounds: Bounds
) -> NDArray[np.int64]:
    """The order in which all is right, if exchanging two markers gives one."""
    moved = _moved(measured[order], last)
    best, least = order, MUCH_BETTER * float(np.nansum(moved))
    if not np.isfinite(moved).any():
        return order  # the first row: nothing to compare with
    for a, b in combinations(range(len(order)), 2):
        if not np.isfinite(measured[order[[a, b]]]).all():
            continue
        tried = order.copy()
        tried[[a, b]] = tried[[b, a]]
        now = measured[tried]
        moved = _moved(now, last)
        total = float(np.nansum(moved))
        right = (moved[[a, b]] <= reach[[a, b]]).all() and _right_for(now, bounds, a, b)
        if right and total < least:
            best, least = tried, total
    return best


def _perhaps_back(
    order: NDArray[np.int64],
    now: Floats,
    measured: Floats,
    last: Floats,
    reach: Floats,
    bounds: Bounds,
) -> NDArray[np.bool_]:
    """(P,) exchanged points, (P, 3) as they are taken, that may as well have their own names again."""
    doubtful = np.zeros(len(order), bool)
    for point in np.flatnonzero(order != np.arange(len(order))):
        both = np.array([point, np.flatnonzero(order == point)[0]])
        back = order.copy()
        back[both] = order[both[::-1]]
        moved, instead = _moved(now, last)[both], _moved(measured[back], last)[both]
        possible = (instead <= reach[both]) | np.isnan(instead)
        as_good = MUCH_BETTER * np.nansum(instead) < np.nansum(moved)
        if possible.all() and as_good and _right_for(measured[back], bounds, *both):
            doubtful[both] = True
    return doubtful


def _right_for(points: Floats, bounds: Bounds, a: int, b: int) -> bool:
    wrong = wrong_rods(points, bounds.rods, bounds.tolerance)
    return not any(w and {rod.a, rod.b} & {a, b} for w, rod in zip(wrong, bounds.rods, strict=True))


def _moved(now: Floats, last: Floats) -> Floats:
    """(P,) how far each point is from where it was last seen [m]; NaN where one is missing."""
    return np.asarray(np.linalg.norm(now - last, axis=-1))


def _roughness(values: Floats) -> float:
    """Standard deviation by quantiles; also where most rows only repeat or interpolate others."""
    found = np.abs(values[np.isfinite(values)])
    if len(found) == 0:
        return 0.0
    half, most = np.quantile(found, [0.5, 0.9])
    return float(max(1.4826 * half, most / 1.645))


def _spread(values: Floats) -> Floats:
    """(columns,) standard deviation by the median, which outliers do not move; 0 of nothing."""
    return np.nan_to_num(1.4826 * medians(np.abs(values)))
