"""Whether a model leaves nothing but noise, and if not, when and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.score import ScoreTest
from flywheel.records import Floats


@dataclass(frozen=True)
class Adequacy:
    """What is left after a model has explained what it can.

    Attributes:
      noise: variance of what is left, per degree of freedom; 1 for nothing but noise.
      correlation: of what is left, from one sample to the next; 0 for white noise.
      inconstancy: of the fitted sizes over windows: mean square of their differences over what noise
        makes of them, of the worst value; 1 for one size everywhere, 0 without sizes.
      by_window: (K,) mean square residual [sigma^2].
      by_point: (P,) the same of each tracked point.
    """

    noise: float
    correlation: float
    inconstancy: float
    by_window: Floats
    by_point: Floats


def adequacy(fitter: Fitter, fit: Fit, test: ScoreTest, known: Floats | None) -> Adequacy:
    """Judge what a fit leaves.

    Args:
      fitter, fit: the model.
      test: on top of it.
      known: (K, D, n) sensitivities of its fitted values; None without any.
    """
    windows = fitter.windows
    shape = windows.measured.shape
    squares = fit.residual.reshape(shape) ** 2
    measured = np.isfinite(windows.measured)
    by_point = squares.sum(axis=(0, 1, 3)) / np.maximum(measured.sum(axis=(0, 1, 3)), 1)
    return Adequacy(
        noise=test.noise,
        correlation=sample_correlation(test.residual, shape),
        inconstancy=_inconstancy(fit, test, known),
        by_window=fitter.mean_squares(fit),
        by_point=by_point,
    )


def sample_correlation(residual: Floats, shape: tuple[int, ...]) -> float:
    """Correlation from one sample to the next of a projected residual (N,) of windows (K, T, P, 3)."""
    count, size = shape[0], int(np.prod(shape[1:]))
    in_time = residual.reshape(count, -1)[:, :size].reshape(shape)
    power = float((in_time**2).sum())
    return float((in_time[:, 1:] * in_time[:, :-1]).sum() / max(power, 1e-300))


def _inconstancy(fit: Fit, test: ScoreTest, known: Floats | None) -> float:
    """Chow's test of each size: is it the same in every window?"""
    if known is None:
        return 0.0
    start = 0
    worst = 0.0
    for term in fit.terms:
        count = len(term.effect.sizes)
        for column in range(start, start + count):
            worst = max(worst, _chow(test, known[..., column]))
        start += len(term.values)
    return worst


def _chow(test: ScoreTest, column: Floats) -> float:
    """Of one size whose sensitivities are (K, D)."""
    projection = test.projection
    starts = projection.of_starts(column[..., None])[..., 0]  # (K, D + X)
    left = test.residual.reshape(starts.shape)
    weight, pull = (starts**2).sum(axis=1), (starts * left).sum(axis=1)
    enough = weight > 1e-3 * weight.sum()
    if enough.sum() < 2:
        return 0.0
    off = pull[enough] / weight[enough]
    mean = (weight[enough] * off).sum() / weight[enough].sum()
    spread = (weight[enough] * (off - mean) ** 2).sum()
    return float(spread / (enough.sum() - 1) / max(test.noise, 1.0))
