"""Swaps and leaps of markers.

A marker moves little between two rows, and the markers of a body keep their distance. If one of
these is violated, either two markers were swapped (then swapping them back corrects both), or a
marker is in a wrong place. A lasting swap is found at its beginning and at its end (see
`following`). If swapped markers reappear and can no longer be distinguished, both are masked: a
missing sample is better than a wrong one.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.geometry import median
from flywheel.data.recordings.pieces import ways
from flywheel.data.recordings.repair.following import NOISES, Bounds, follow
from flywheel.data.recordings.repair.strays import islands, spikes
from flywheel.data.recordings.report import Finding
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot


@dataclass(frozen=True)
class Tracked:
    """Points after the analysis of their motion.

    Attributes:
      points: (N, P, 3), swapped markers corrected, wrong samples NaN [m].
      ordered: (N, P, 3) the same including the wrong samples [m].
      exchanged: (N, P) samples under another marker's name.
      partner: (N, P) index of that marker.
      doubtful: (N, P) samples that may be swapped.
      leaps: (N, P) samples masked as leaps.
      rods: (N, P) samples masked because of a wrong distance.
    """

    points: Floats
    ordered: Floats
    exchanged: NDArray[np.bool_]
    partner: NDArray[np.int16]
    doubtful: NDArray[np.bool_]
    leaps: NDArray[np.bool_]
    rods: NDArray[np.bool_]


def track(points: Floats, time: Floats, robot: Robot) -> Tracked:
    """Follow the markers (N, P, 3) [m] through times (N,) [s].

    Raises:
      DataError: they usually move too far between rows to be followed.
    """
    bounds = Bounds.of(points, robot)
    usual = median(ways(points, 1).ravel())
    most = robot.length + bounds.speed * float(np.median(np.diff(time)))
    if usual > most:
        raise DataError(
            f"the points usually move by {usual:.3g} m from row to row; at most {most:.3g} m can be noise "
            f"and motion of a robot of {robot.length:.3g} m. Are the rows in the order of time?"
        )
    followed = follow(points, time, bounds)
    swapped = followed.order != np.arange(points.shape[1])
    ordered = points
    if swapped.any():
        ordered = np.take_along_axis(points, followed.order[..., None].astype(np.int64), axis=1)
    found, leaps, rods = _without_strays(ordered, followed.leaps, followed.rods, time, bounds)
    seen_well = np.isfinite(found[..., 0])
    doubtful = np.arange(len(points))[:, None] >= followed.doubted
    exchanged = swapped & seen_well & ~doubtful
    return Tracked(found, ordered, exchanged, followed.order, doubtful & seen_well, leaps, rods)


def _without_strays(
    ordered: Floats, leaps: NDArray[np.bool_], rods: NDArray[np.bool_], time: Floats, bounds: Bounds
) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
    """The points, and the masks for leaps and rods, after checks before and after each row."""
    # The line between two neighbours has half their variance.
    noise = NOISES * bounds.noise * np.sqrt(1.5)
    # A sample within reach from before, from where the next is not, though that one is from before:
    first = spikes(ordered, time, bounds.kick, noise)[:-1] & ~leaps[:-1] & ~rods[:-1] & leaps[1:]
    past = ways(ordered, 2) <= bounds.reach((time[2:] - time[:-2])[:, None])
    first[0] = False
    first[1:] &= past
    leaps = leaps.copy()
    leaps[:-1] |= first
    leaps[1:] &= ~first
    found = np.where((leaps | rods)[..., None], np.nan, ordered)
    steady = ways(ordered, 1) <= bounds.reach(np.diff(time)[:, None])
    chance = islands(leaps | rods, np.isfinite(found[..., 0]), steady, time)
    by_rod = chance & rods.any(axis=0)
    found[chance] = np.nan
    leaps = leaps | (chance & ~by_rod) | spikes(found, time, bounds.kick, noise)
    found[leaps] = np.nan
    return found, leaps, rods | by_rod


def judged(
    tracked: Tracked, robot: Robot, time: Floats, repair: bool
) -> tuple[Floats, list[Finding]]:
    """The usable points (N, P, 3), and the findings.

    Args:
      repair: keep swapped markers, corrected, if the assignment is certain; else mask them.
    """
    names = [point.name for point in robot.points]
    findings = []
    points = tracked.points
    for a, b in combinations(range(len(names)), 2) if tracked.exchanged.any() else ():
        between = tracked.partner[:, a] == b
        where = (tracked.exchanged[:, a] | tracked.exchanged[:, b]) & between
        if where.any():
            words = (
                "corrected; to mask them instead, write repair: [] in the map"
                if repair
                else "swapped, and not corrected, as requested by the map"
            )
            action = "repaired" if repair else "masked"
            pair = f"{names[a]} and {names[b]}"
            findings.append(Finding.over("swap", action, pair, where, time, words))  # type: ignore[arg-type]
    if not repair:
        points[tracked.exchanged] = np.nan
    points[tracked.doubtful] = np.nan
    for kind, masks, words in (
        ("swap", tracked.doubtful, "swapped, then unseen: they can no longer be distinguished"),
        ("leap", tracked.leaps, "further away than it can have moved"),
        ("rod length", tracked.rods, "not at its distance from the body's other markers"),
    ):
        for index in np.flatnonzero(masks.any(axis=0)):
            where = masks[:, index]
            findings.append(Finding.over(kind, "masked", names[index], where, time, words))
    return points, findings
