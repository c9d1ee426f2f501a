"""Adequacy: a test that the residual of a model is noise, and its location if it is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.selection.scores import ScoreTest
from flywheel.diagnosis.statistics import RARE
from flywheel.records import Floats

# Smallest share of a window in the information on a size, below which it is ignored.
LEAST_TOLD = 1e-3
QUANTILE = 0.95  # of a model's own errors that its residual must exceed
# Ratio to the mean square of an unfitted start, above which a window's fit has not converged.
ASTRAY = 4.0


@dataclass(frozen=True)
class Adequacy:
    """Residual of a model, summarised.

    Attributes:
      noise: variance of the residual, per degree of freedom; 1 for pure noise.
      doubt: its standard deviation, because the noise is not known exactly.
      loudest: of one window, excess over that in standard deviations of pure noise.
      correlation: of the residual, from one sample to the next; 0 for white noise.
      inconstancy: of the fitted sizes over windows: squares of their differences relative to the
        99.9 % quantile of noise, of the worst size; above 1 for sizes that differ.
      beyond_noise: root mean square of the residual beyond noise [m].
      converged: most windows fit no worse than from the first estimates of their initial states.
    """

    noise: float
    doubt: float
    loudest: float
    correlation: float
    inconstancy: float
    beyond_noise: float
    converged: bool = True

    @property
    def constant(self) -> bool:
        """True if fitted sizes are the same everywhere."""
        return self.inconstancy < 1.0


@dataclass(frozen=True)
class OwnErrors:
    """Upper limits of statistics caused by a model's own errors.

    Attributes:
      score: best score of any candidate.
      noise, correlation, loudest: of their residual, as in `Adequacy`.
    """

    score: float
    noise: float
    correlation: float
    loudest: float


def own_errors(fitter: Fitter, test: ScoreTest) -> OwnErrors | None:
    """Result of a test on the model's own errors, in unseen draws; None without any."""
    draws = fitter.own_errors
    if not draws.shape[2]:
        return None
    noisy = fitter.windows.noisy_in_each
    found = []
    for draw in np.moveaxis(draws, 2, 0):
        there = test.at(draw)
        best = max(score.score for score in there.scores())
        loud = float(there.left @ there.left) / max(test.freedom, 1.0)
        correlation = sample_correlation(there.left, fitter.windows.measured.shape)
        found.append((best, loud, correlation, loudest(there.left, noisy, test.freedom)))
    return OwnErrors(*np.quantile(found, QUANTILE, axis=0).tolist())


def adequacy(fitter: Fitter, fit: Fit, test: ScoreTest, by_value: Floats) -> Adequacy:
    """Assess the residual of a fit; every window counts in full.

    Args:
      fitter, fit: the model.
      test: on top of it.
      by_value: (K, D, n) sensitivities to its fitted values.
    """
    windows = fitter.windows
    shape = windows.measured.shape
    unfitted = fitter.mean_squares(fitter.first_estimate(fit.terms))
    return Adequacy(
        noise=test.left_noise,
        doubt=windows.doubt,
        loudest=loudest(test.left, windows.noisy_in_each, test.left_freedom),
        correlation=sample_correlation(test.left, shape),
        inconstancy=_inconstancy(fit, test, by_value),
        beyond_noise=test.beyond_noise(fitter),
        converged=mostly(~astray(fitter, fit, unfitted)),
    )


def astray(fitter: Fitter, fit: Fit, unfitted: Floats) -> np.ndarray:
    """(K,) bool: windows whose fits have not converged.

    Args:
      fitter, fit: the model.
      unfitted: (K,) mean squares of the same windows with unfitted starts; NaN where not known [sigma^2].
    """
    most = ASTRAY * np.maximum(unfitted, 1.0)
    return np.asarray(fitter.mean_squares(fit) > most)


def mostly(converged: np.ndarray) -> bool:
    """True if enough of the windows (K,) converged for an assessment: at least half."""
    return bool(converged.mean() >= 0.5)


def loudest(left: Floats, noisy: np.ndarray, freedom: float) -> float:
    """Largest excess of the squares of one window, of which (K,) coordinates have noise."""
    squares = (left.reshape(len(noisy), -1) ** 2).sum(axis=1)
    free = noisy * freedom / max(1, noisy.sum())
    return float(((squares - free) / np.sqrt(2.0 * np.maximum(free, 1.0))).max())


def sample_correlation(residual: Floats, shape: tuple[int, ...]) -> float:
    """Correlation from one sample to the next of a projected residual (N,) of windows (K, T, P, 3)."""
    count, size = shape[0], int(np.prod(shape[1:]))
    in_time = residual.reshape(count, -1)[:, :size].reshape(shape)
    power = float((in_time**2).sum())
    return float((in_time[:, 1:] * in_time[:, :-1]).sum() / max(power, 1e-300))


def _inconstancy(fit: Fit, test: ScoreTest, by_value: Floats) -> float:
    """Chow's test of each size: equality over all windows."""
    start = 0
    worst = 0.0
    for term in fit.terms:
        count = len(term.effect.sizes) if term.asked else 0
        for column in range(start, start + count):
            worst = max(worst, _chow(test, by_value[..., column]))
        start += len(term.values)
    return worst


def _chow(test: ScoreTest, column: Floats) -> float:
    """Statistic of one size, whose sensitivities are (K, D), over its rare quantile (Chow 1960)."""
    projection = test.projection
    own = projection.without_local(column[..., None])[..., 0]  # (K, D + X)
    left = test.residual.reshape(own.shape)
    weight, right = (own**2).sum(axis=1), (own * left).sum(axis=1)
    enough = weight > LEAST_TOLD * weight.sum()
    if enough.sum() < 2:
        return 0.0
    off = right[enough] / weight[enough]
    mean = (weight[enough] * off).sum() / weight[enough].sum()
    spread = (weight[enough] * (off - mean) ** 2).sum()
    limit = chi2.ppf(1.0 - RARE, enough.sum() - 1)
    return float(spread / limit / max(test.noise, 1.0))
