"""Wrong samples recognisable from their neighbours in time only: away for one row, or right by chance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.pieces import distance, pieces
from flywheel.records import Floats

SIGHT = 2.5  # usual periods: neighbours further apart say nothing
ISLAND_SECONDS = 0.5  # shorter runs of right samples between wrong ones are chance


def spikes(points: Floats, time: Floats, kick: float, noise: float) -> NDArray[np.bool_]:
    """(N, P) samples too far from the line between the ones before and after them.

    Args:
      points: (N, P, 3) [m]; NaN where missing.
      time: (N,) [s].
      kick: largest change of a marker's velocity from one row to the next [m/s].
      noise: largest distance from that line due to noise alone [m].
    """
    found = np.zeros(points.shape[:2], bool)
    if len(points) < 3:
        return found
    before, after = np.diff(time)[:-1], np.diff(time)[1:]
    share = (before / (before + after))[:, None, None]
    off = np.zeros(points.shape[:2])
    for some in pieces(len(share), points[0].size):
        first, now, then = (points[some.start + i : some.stop + i] for i in range(3))
        line = first + share[some] * (then - first)
        off[1:-1][some] = np.nan_to_num(distance(now, line))
    close = (before + after) <= 2 * SIGHT * np.median(np.diff(time))
    # A velocity that changes by `kick` in a row leaves the line by so much.
    allowed = (kick * before * after / (before + after) + noise)[:, None]
    # The spike itself is further off than its neighbours, whose lines it bends by half.
    highest = (off[1:-1] > off[:-2]) & (off[1:-1] > off[2:])
    found[1:-1] = (off[1:-1] > allowed) & highest & close[:, None]
    return found


def islands(
    wrong: NDArray[np.bool_], seen: NDArray[np.bool_], steady: NDArray[np.bool_], time: Floats
) -> NDArray[np.bool_]:
    """(N, P) present samples in short runs between wrong ones, without a leap to or from these.

    A marker that stays in a wrong place is now and then at the right distance from its partner.

    Args:
      wrong: (N, P) samples known to be wrong.
      seen: (N, P) samples that seem right.
      steady: (N - 1, P) True without a leap of the measured marker between two rows.
      time: (N,) [s].
    """
    found = np.zeros_like(wrong)
    for marker in np.flatnonzero(wrong.any(axis=0)):
        rows = np.flatnonzero(wrong[:, marker])
        a, b = rows[:-1], rows[1:]
        joined = steady[a, marker] | steady[b - 1, marker]
        short = (b - a > 1) & joined & (time[b] - time[a] < ISLAND_SECONDS)
        edges = np.zeros(len(wrong), np.int8)
        edges[a[short] + 1], edges[b[short]] = 1, -1
        found[:, marker] = seen[:, marker] & (np.cumsum(edges, dtype=np.int8) > 0)
    return found
