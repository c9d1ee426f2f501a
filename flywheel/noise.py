"""Noise of measurements, told from their differences in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.errors import DataError
from flywheel.records import Floats

ORDER = 4  # of the differences that show the noise: motion that is smooth over five samples cancels
GAIN = np.sqrt(70.0)  # standard deviation of a fourth difference of unit white noise
NORMAL = 0.6745  # median absolute deviation of a unit normal
ROUNDING = 1e-12  # of numbers that are computed, relative to them
UNIFORM = 12.0**-0.5  # standard deviation of what rounding to whole numbers adds
DOUBT = 3.2  # by simulation: neighbouring differences share samples, and a median wastes some
# Share of samples in a steady rhythm, from which on a longer control step has most of them.
EVEN = 0.8
FEWEST = 50  # differences below which an estimate means nothing


def noise_floor(points: Sequence[Floats]) -> float:
    """Standard deviation of the noise of each coordinate [m].

    From the median of fourth differences in time, which are insensitive to smooth motion and a few
    leaps. Gaps leave out the differences that reach over them. A sensor that counts in steps and
    mostly repeats a value is as good as its steps. Constant coordinates are ignored: a planar
    robot's third one, or a marker on the frame.

    Args:
      points: (T + 1, P, 3) of each recording, at regular times; NaN where missing [m].

    Raises:
      DataError: too few samples in a row, or all of them are constant.
    """
    known = _differences(points)
    if len(known) < FEWEST:
        raise DataError(
            f"The noise needs {FEWEST} differences over {ORDER + 1} samples in a row, got {len(known)}; "
            f"coordinates that never change do not count.{_slower(points)}"
        )
    noise = _spread(known)
    return noise if noise > _rounding(points) else _resolution(points) * UNIFORM


def filled_in(points: Sequence[Floats]) -> np.ndarray:
    """(R, P, 3) bool: constant coordinates in a recording with noise in the others.

    They were not measured: a planar robot's third one, for example. If a sensor counts in steps
    above the noise, a resting point repeats its values, too: there, only those of a moving point
    count.

    Args:
      points: (T + 1, P, 3) of each of R recordings; NaN where missing [m].
    """
    still = np.stack([~_changes(p).reshape(p.shape[1:]) for p in points])
    noise = _spread(_differences(points))
    if noise <= _rounding(points):
        return np.zeros_like(still)
    return still if noise > _resolution(points) else still & ~still.all(axis=2, keepdims=True)


def noise_doubt(points: Sequence[Floats]) -> float:
    """Standard deviation of one over the estimated variance, for a true one of 1; arguments as above."""
    return DOUBT / float(np.sqrt(max(1, len(_differences(points)))))


def _slower(points: Sequence[Floats]) -> str:
    """How a log of a slower sensor can be used, as a sentence; "" if the sensor is not slower."""
    seen = [np.flatnonzero(np.isfinite(p[:, i, 0])) for p in points for i in range(p.shape[1])]
    apart = np.concatenate([np.diff(rows) for rows in seen] or [np.empty(0)])
    if len(apart) == 0 or (steps := np.median(apart)) <= 1:
        return ""
    words = f" Most samples are {steps:.0f} control steps apart"
    if (apart % steps == 0).mean() < EVEN:
        return f"{words}, but not evenly: only diagnose can use them, with --noise."
    return f"{words}: a --dt {steps:.0f} times as long has all."


def _differences(points: Sequence[Floats]) -> Floats:
    """(n,) fourth differences of all changing coordinates measured five times in a row."""
    flat = [p.reshape(len(p), -1)[:, _changes(p)] for p in points if len(p) > ORDER]
    found = [np.diff(p, ORDER, axis=0).ravel() for p in flat]
    return np.concatenate([d[np.isfinite(d)] for d in found] or [np.empty(0)])


def _resolution(points: Sequence[Floats]) -> float:
    """Smallest difference of two values in a row [m]."""
    steps = np.concatenate([np.abs(np.diff(p, axis=0)).ravel() for p in points])
    return float(steps.min(where=steps > _rounding(points), initial=np.inf))


def _spread(differences: Floats) -> float:
    """Standard deviation of the noise, from fourth differences (n,) [m]; 0 without any."""
    return float(np.median(np.abs(differences)) / (NORMAL * GAIN)) if len(differences) else 0.0


def _changes(points: Floats) -> np.ndarray:
    """(3 P,) bool: True for changing coordinates of points (T + 1, P, 3)."""
    flat = points.reshape(len(points), -1)
    seen = np.isfinite(flat)
    highest = flat.max(axis=0, where=seen, initial=-np.inf)
    return np.asarray(highest - flat.min(axis=0, where=seen, initial=np.inf) > _rounding([points]))


def _rounding(points: Sequence[Floats]) -> float:
    """Rounding error of numbers of this size [m]."""
    return ROUNDING * max(float(np.abs(p).max(where=np.isfinite(p), initial=0.0)) for p in points)
