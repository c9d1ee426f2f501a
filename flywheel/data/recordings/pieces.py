"""Long arrays, a piece at a time, so that what is in between is never as large as they are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flywheel.records import Floats

AT_ONCE = 1 << 18  # numbers: few enough for the processor's cache


def pieces(rows: int, numbers: int) -> Iterator[slice]:
    """Slices of so many rows, each of so many numbers."""
    step = max(1, AT_ONCE // max(1, numbers))
    yield from (slice(begin, min(begin + step, rows)) for begin in range(0, rows, step))


def distance(here: Floats, there: Floats) -> Floats:
    """(...) between points (..., 3) [m]; NaN where one is missing."""
    return np.asarray(np.linalg.norm(here - there, axis=-1))


def ways(points: Floats, rows: int) -> Floats:
    """(N - rows, P) how far each of points (N, P, 3) has come in so many rows [m]."""
    found = np.empty((max(0, len(points) - rows), points.shape[1]))
    for some in pieces(len(found), points[0].size):
        ahead = slice(some.start + rows, some.stop + rows)
        found[some] = distance(points[ahead], points[some])
    return found
