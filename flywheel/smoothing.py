"""Position and velocity of tracked points from noisy samples with gaps: three methods for three
situations.

- `causal_polynomial`: only the past is known, as in a prediction while the robot moves.
- `local_regression`: samples on both sides of one instant, perhaps few of them; a prior on speed
  and acceleration prevents a few samples from determining a gap.
- `savitzky_golay`: a whole recording at once, for states at every sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.errors import DataError
from flywheel.records import Floats


@dataclass(frozen=True)
class MotionPrior:
    """Standard deviations of a robot's motion, in natural units: its length L, and sqrt(L / g) for time.

    Attributes:
      speed, acceleration, jerk: usual values of cable robots of every size.
    """

    speed: float = 0.5
    acceleration: float = 1.0
    jerk: float = 4.0


def causal_polynomial(points: Floats, dt: float, degree: int) -> tuple[Floats, Floats]:
    """Present positions and velocities of points, by a polynomial through their recent positions.

    Args:
      points: (B, w + 1, P, 3), oldest first; NaN where missing [m].
      dt: time between them [s].
      degree: of the polynomial.

    Returns:
      (B, P, 3) positions [m] and velocities [m/s]; NaN and zero if too few positions are known.
    """
    steps = points.shape[1]
    time = np.arange(1 - steps, 1) / max(1, steps - 1)
    powers = time[:, None] ** np.arange(min(degree, steps - 1) + 1)
    known = np.swapaxes(np.isfinite(points).all(axis=-1), 1, 2)  # (B, P, w + 1)
    places = np.where(known[..., None], points.swapaxes(1, 2), 0.0)
    fit = np.linalg.pinv(known[..., None] * powers) @ places
    enough = (known.sum(axis=-1) >= powers.shape[1])[..., None]
    now = np.where(enough, fit[..., 0, :], np.nan)
    if steps == 1:
        return now, np.zeros_like(now)
    return now, np.where(enough, fit[..., 1, :] / (dt * (steps - 1)), 0.0)


def local_regression(
    points: Floats,
    at: int,
    reach: int,
    dt: float,
    time: float,
    sigma: float,
    prior: MotionPrior = MotionPrior(),
) -> tuple[Floats, Floats]:
    """Positions and velocities at one sample, by parabolas through the samples around it.

    A parabola is valid for a while only: the possible influence of jerk counts as noise of a
    sample, so that nearby samples dominate. The prior on speed and acceleration matters if there
    are few samples (local Bayesian regression).

    Args:
      points: (T + 1, P, 3) of the whole recording; NaN where missing [m].
      at: index of the sample.
      reach: samples to either side; doubled until each point was seen there at least once.
      dt: between samples [s].
      time: natural unit of time of the robot, sqrt(L / g) [s].
      sigma: noise of a coordinate, in robot lengths.
      prior: on the motion.

    Returns:
      (P, 3) positions [m] and velocities [m/s].

    Raises:
      DataError: a point was never seen.
    """
    around = _around(points, at, reach)
    near = points[around]
    known = np.asarray(np.isfinite(near).all(axis=-1))
    instants = (np.arange(len(points))[around] - at) * dt / time
    powers = np.stack([np.ones_like(instants), instants, instants**2 / 2], axis=1)
    variance = sigma**2 + (prior.jerk * instants**3 / 6) ** 2
    weighted = (known.T / variance)[..., None] * powers  # (P, n, 3)
    usual = np.diag([0.0, prior.speed**-2, prior.acceleration**-2])
    seen = np.where(known[..., None], near, 0.0).swapaxes(0, 1)
    fit = np.linalg.solve(weighted.swapaxes(1, 2) @ powers + usual, weighted.swapaxes(1, 2) @ seen)
    return fit[:, 0], fit[:, 1] / time


def savitzky_golay(points: Floats, dt: float, seconds: float) -> tuple[Floats, Floats]:
    """Positions and velocities at every sample, by parabolas through those around; gaps are bridged.

    Args:
      points: (T + 1, P, 3); NaN where missing [m].
      dt: between them [s].
      seconds: length of the parabolas [s].

    Returns:
      (T + 1, P, 3) positions [m] and velocities [m/s].

    Raises:
      DataError: a point was never seen.
    """
    # Start-up time: scipy.signal takes longer to import than everything that plants need.
    from scipy.signal import savgol_filter

    known = np.asarray(np.isfinite(points).all(axis=-1))
    _require_seen(known)
    filled, time = points.copy(), np.arange(len(points))
    for point, axis in np.ndindex(points.shape[1:]):
        there = known[:, point]
        filled[:, point, axis] = np.interp(time, time[there], points[there, point, axis])
    size = min(2 * round(seconds / dt / 2) + 1, len(points) - 1 + len(points) % 2)  # odd
    degree = min(2, size - 1)
    return (
        savgol_filter(filled, size, degree, axis=0),
        savgol_filter(filled, size, degree, deriv=1, delta=dt, axis=0),
    )


def _around(points: Floats, at: int, reach: int) -> slice:
    """Samples around one, as far as every point of (T + 1, P, 3) is seen there at least once."""
    known = np.asarray(np.isfinite(points).all(axis=-1))
    _require_seen(known)
    while True:
        around = slice(max(0, at - reach), at + reach + 1)
        if known[around].any(axis=0).all():
            return around
        reach *= 2


def _require_seen(known: np.ndarray) -> None:
    """Raise if a point of (T + 1, P) bool was never seen."""
    if not known.any(axis=0).all():
        raise DataError(f"Tracked point {int(np.argmin(known.any(axis=0)))} was never seen.")


def interpolated(values: Floats, at: Floats) -> Floats:
    """(n, m, C) of values (n, T, C), at samples `at` (n, m), linearly between two of them."""
    before = np.floor(at).astype(int)
    part = (at - before)[..., None]
    earlier, later = (
        np.take_along_axis(values, each[..., None], axis=1)
        for each in (before, np.minimum(before + 1, values.shape[1] - 1))
    )
    return np.where(part == 0, earlier, (1 - part) * earlier + part * later)
