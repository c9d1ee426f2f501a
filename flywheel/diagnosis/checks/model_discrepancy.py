"""Model discrepancy: the unexplained error as a second scale of error besides noise.

Measurements are often a hundred times better than any model. The residual of the best one is then
not noise: it is correlated in time and between the points of a body. Treated as noise of the same
mean square it would be averaged out over thousands of samples, and any effect that reduces it
slightly would be certain. It is therefore treated as the white noise that disturbs a fit equally:
its long-run variance (Newey and West 1987), over as many points as move independently.
"""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.records import Floats

FREEDOMS = 6  # of a rigid body


def model_discrepancy(fitter: Fitter, fit: Fit) -> float:
    """Residual of a model beyond noise, as the standard deviation of equally disturbing white noise [m].

    Args:
      fitter, fit: of the best model.
    """
    windows = fitter.windows
    residual = np.where(windows.noisy, fit.residual.reshape(windows.measured.shape), 0.0)
    coordinates = (~windows.filled).sum(axis=(1, 2)).mean()
    # What was filled in holds the other freedoms.
    freedoms = FREEDOMS * fitter.taken.mean() / len(fitter.local_prior)
    together = max(1.0, coordinates / (freedoms * len(windows.robot.bodies)))
    usual = windows.noisy.sum() / max(1.0, fitter.freedom)
    square = windows.sigma**2 * usual * long_run_variance(residual, windows.noisy)
    return float(np.sqrt(together * max(0.0, square - windows.noise**2)))


def long_run_variance(series: Floats, known: np.ndarray) -> float:
    """Variance of the sum of correlated samples, per sample, with Bartlett's weights.

    Args:
      series: (K, T, ...) along the second axis; 0 where unknown.
      known: (K, T, ...) bool.
    """
    length, count = series.shape[1], max(1, int(known.sum()))
    variance = float((series**2).sum())
    for lag in range(1, length):
        products = float((series[:, lag:] * series[:, :-lag]).sum())
        variance += 2.0 * (1.0 - lag / length) * products
    return variance / count
