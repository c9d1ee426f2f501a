"""How noisy measured positions are, from the measurements alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.errors import DataError
from flywheel.records import Floats

ORDER = 4  # of the differences: motion that is smooth over five samples cancels
GAIN = np.sqrt(70.0)  # standard deviation of a fourth difference of unit white noise
NORMAL = 0.6745  # median absolute deviation of a unit normal
DOUBT = 3.2  # by simulation: neighbouring differences share samples, and a median wastes some
FEWEST = 50  # differences below which an estimate means nothing


def noise_floor(points: Sequence[Floats]) -> float:
    """Standard deviation of the noise of each coordinate [m].

    From the median of fourth differences in time, which neither smooth motion nor a few leaps change.
    Gaps leave out the differences that reach over them.

    Args:
      points: (T + 1, P, 3) of each recording, at regular times; NaN where missing [m].

    Raises:
      DataError: too few samples in a row.
    """
    known = _differences(points)
    if len(known) < FEWEST:
        raise DataError(
            f"The noise needs {FEWEST} differences over {ORDER + 1} samples in a row, got {len(known)}."
        )
    return float(np.median(np.abs(known)) / (NORMAL * GAIN))


def noise_doubt(points: Sequence[Floats]) -> float:
    """Standard deviation of one over the estimated variance, for a true one of 1; arguments as above."""
    return DOUBT / float(np.sqrt(max(1, len(_differences(points)))))


def _differences(points: Sequence[Floats]) -> Floats:
    """(n,) fourth differences of everything that was measured five times in a row."""
    differences = [np.diff(p, ORDER, axis=0).ravel() for p in points if len(p) > ORDER]
    return np.concatenate([d[np.isfinite(d)] for d in differences] or [np.empty(0)])
