"""Bootstrap null: a model's errors due to noise alone, by a parametric bootstrap for any dynamics model.

If the model were the truth, its predictions would still have errors: measurements have noise, as do
the pasts from which it starts, and it may estimate invisible quantities wrongly. The effect of that
depends on the model, the robot and the motion, so it is simulated. In each draw the model moves
through the recorded commands, from some time before every window; that is taken as the truth, noise
is added, and the model predicts it from the noisy past.

An untrained model can have errors of metres due to noise in its start alone, and so pass any test
of the size of its error. But noise in the start affects predictions in few directions only. Half of
the draws determine these; the other half give the distribution of errors with these directions
down-weighted, with which the model's error on the recording is compared. Changes caused by smaller
time steps of a plant are numerical, not physical, and are down-weighted as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.dynamics.plant import RestartedPlant, refined, with_effects
from flywheel.records import Floats, Observation, Past

ROWS = 1024  # predictions in one rollout call
BAND = (0.025, 0.5, 0.975)


@dataclass(frozen=True)
class BootstrapNull:
    """A model's errors, and those in its own world, in noise variances.

    Attributes:
      by_lead: (draws, steps) mean square over the windows, in its own world.
      left: (K,) mean square of each window beyond the influence of noise on starts.
      own: (draws / 2, K) the same in its own world.
    """

    by_lead: Floats
    left: Floats
    own: Floats

    @property
    def band(self) -> Floats:
        """(2, steps) 95 % band of the mean square at each lead time due to noise alone."""
        return np.asarray(np.quantile(self.by_lead, (BAND[0], BAND[-1]), axis=0))

    @property
    def rms(self) -> tuple[float, float, float]:
        """Root mean square due to noise alone: lower bound of 95 %, median, upper bound [sigma]."""
        low, middle, high = np.quantile(np.sqrt(np.nanmean(self.by_lead, axis=1)), BAND)
        return float(low), float(middle), float(high)

    @property
    def excess(self) -> float:
        """Residual of windows relative to that of noise alone."""
        return float(self._excess(self.left))

    @property
    def probability(self) -> float:
        """Probability of at least as much excess by noise alone."""
        as_much = (self._excess(self.own) >= self._excess(self.left)).sum()
        return float((1 + as_much) / (1 + len(self.own)))

    def _excess(self, left: Floats) -> Floats:
        """Geometric mean over windows, so that one diverging window counts as one."""
        typical = np.median(self.own, axis=0)
        return np.asarray(np.exp(np.log(left / typical).mean(axis=-1)))


def bootstrap_null(
    subject: Subject, windows: ForecastWindows, points: Floats, draws: int, rng: np.random.Generator
) -> BootstrapNull:
    """Compare a model's error with those in its own world.

    Args:
      subject: the model.
      windows: the windows.
      points: (K, steps + 1, P, 3) its predictions there [m].
      draws: of the noise.
      rng: of the noise.

    Raises:
      ModelError: its predictions in its own world are not finite.
    """
    size = max(1, ROWS // draws)
    parts, squares, counts = [], 0.0, 0.0
    for begin in range(0, len(windows), size):
        some = slice(begin, begin + size)
        here = windows[some]
        known = np.isfinite(here.measured)
        wrong, noise = (np.where(known, p, 0.0) for p in _drawn(subject, here, draws, rng))
        residual, numbers = (
            np.where(known, (p - points[some, 1:]) / here.sigma, 0.0)
            for p in (here.measured, _finer(subject, here, points[some])[:, 1:])
        )
        squares = squares + ((wrong + noise) ** 2).sum(axis=(1, 3, 4))
        counts = counts + known.sum(axis=(0, 2, 3))
        parts.append(_left(wrong, noise, residual, numbers, known.sum(axis=(1, 2, 3))))
    left, own = (np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))
    by_lead = np.where(counts, squares / np.maximum(counts, 1), np.nan)
    return BootstrapNull(np.asarray(by_lead), left, own)


def _drawn(
    subject: Subject, windows: ForecastWindows, draws: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Errors of predictions in the model's own world, and the noise of the measurements there.

    Both are (draws, K, steps, P, 3) [sigma].
    """
    model, warmup, count = subject.dynamics, windows.warmup, len(windows)
    origin = repeated(windows.origin(subject), draws)
    shaken = origin.observations.points
    shaken = shaken + rng.normal(0.0, windows.sigma, shaken.shape)
    origin = replace(origin, observations=Observation(shaken, origin.observations.winch))
    world = model.rollout(origin, np.tile(windows.controls(warmup), (draws, 1, 1)))
    noise = rng.normal(size=world.points.shape)
    measured = windows.past(subject)
    seen = repeated(measured, draws).observations
    now = slice(warmup - model.history, warmup + 1)
    points = (world.points + windows.sigma * noise)[:, now]
    past = replace(
        repeated(measured, draws),
        observations=Observation(
            np.where(np.isfinite(seen.points), points, np.nan),
            np.where(np.isfinite(seen.winch), world.winch[:, now], np.nan),
        ),
        winch=world.winch[:, now],
    )
    predicted = model.rollout(past, np.tile(windows.controls(), (draws, 1, 1))).points[:, 1:]
    wrong = (world.points[:, warmup + 1 :] - predicted) / windows.sigma
    shape = (draws, count, *wrong.shape[1:])
    return wrong.reshape(shape), noise[:, warmup + 1 :].reshape(shape)


def _finer(subject: Subject, windows: ForecastWindows, points: Floats) -> Floats:
    """Predictions of a plant with smaller time steps, for points (K, steps + 1, P, 3) [m].

    Of other models the points themselves.
    """
    model = subject.dynamics
    if not isinstance(model, RestartedPlant):
        return points
    finer = replace(model, plant=with_effects(refined(model.plant), model.plant.terms))
    past = windows.past(subject)
    return finer.rollout(past, windows.controls()).points


def _left(
    wrong: Floats, noise: Floats, residual: Floats, numbers: Floats, known: Floats
) -> tuple[Floats, Floats]:
    """Mean squares of errors, weighted by the influence of noise on starts.

    With errors by starts of covariance C and noise of covariance 1, the square of an error r is r'
    (1 + C)^-1 r; C is that of the first half of the draws, and of the numbers.

    Args:
      wrong, noise: (draws, K, ...) errors in the model's own world, and noise [sigma].
      residual: (K, ...) of the recording [sigma]. All are 0 for missing measurements.
      numbers: (K, ...) changes by smaller time steps [sigma].
      known: (K,) number of measurements.

    Returns:
      (K,) of the recording, (draws / 2, K) of the second half of the draws.
    """
    draws, count = wrong.shape[:2]
    half = draws // 2
    by_start = np.swapaxes(wrong[:half].reshape(half, count, -1), 0, 1) / np.sqrt(half)
    ways = np.concatenate([by_start, numbers.reshape(count, 1, -1)], axis=1)
    _, size, ways = np.linalg.svd(ways, full_matrices=False)  # (K, n), (K, n, D)
    own = (wrong + noise)[half:].reshape(draws - half, count, -1)
    errors = np.concatenate([own, residual.reshape(1, count, -1)])
    along = np.einsum("knd,ekd->ekn", ways, errors, optimize=True)
    share = size**2 / (1.0 + size**2)
    squares = (errors**2).sum(axis=-1) - (share * along**2).sum(axis=-1)
    mean = squares / np.maximum(known, 1)
    return mean[-1], mean[:-1]


def mean_by_lead(squares: Floats) -> Floats:
    """(steps,) mean over windows, points and axes of (K, steps, P, 3); NaN if unknown."""
    count = np.isfinite(squares).sum(axis=(0, 2, 3))
    total = np.nansum(squares, axis=(0, 2, 3))
    return np.asarray(np.where(count, total / np.maximum(count, 1), np.nan))


def repeated(past: Past, count: int) -> Past:
    """The batch, repeated."""

    def many(array: Floats) -> Floats:
        return np.tile(array, (count,) + (1,) * (array.ndim - 1))

    seen = past.observations
    return replace(
        past,
        observations=Observation(many(seen.points), many(seen.winch)),
        controls=many(past.controls),
        winch=many(past.winch),
        terrains=past.terrains if len(past.terrains) == 1 else past.terrains * count,
    )
