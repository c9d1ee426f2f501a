"""Long arrays in pieces, which bounds the memory of intermediate results."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flywheel.records import Floats

AT_ONCE = 1 << 18  # numbers: few enough for the processor's cache


def pieces(rows: int, numbers: int) -> Iterator[slice]:
    """Slices of limited size, given the numbers per row."""
    step = max(1, AT_ONCE // max(1, numbers))
    yield from (slice(begin, min(begin + step, rows)) for begin in range(0, rows, step))


def distance(here: Floats, there: Floats) -> Floats:
    """(...) distances between points (..., 3) [m]; NaN if one is missing."""
    way = here - there
    return np.sqrt(np.einsum("...i,...i->...", way, way))


def ways(points: Floats, rows: int) -> Floats:
    """(N - rows, P) distance moved by each of points (N, P, 3) in the given number of rows [m]."""
    found = np.empty((max(0, len(points) - rows), points.shape[1]))
    for some in pieces(len(found), points[0].size):
        ahead = slice(some.start + rows, some.stop + rows)
        found[some] = distance(points[ahead], points[some])
    return found
