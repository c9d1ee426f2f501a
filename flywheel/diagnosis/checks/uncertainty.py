"""Uncertainty of fitted values, and their bias due to the plant's time step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Jacobian
from flywheel.diagnosis.fitting.projection import Projection
from flywheel.diagnosis.statistics import INTERVAL
from flywheel.records import Floats

# 1 + 1/2 + 1/4 + ...: what all further halvings of the time step change, over what one does.
HALVINGS = 2.0


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of n fitted values, in their units.

    Attributes:
      deviations: (n,) standard deviations of the values without `by_step`.
      by_step: (n,) bias of the values due to the plant's time step. A plant with long steps fits
        best with values that compensate for them; the robot's values exclude this.
    """

    deviations: Floats
    by_step: Floats


def uncertainty(
    fitter: Fitter, fit: Fit, jacobian: Jacobian | None = None, known_to: float = 0.0
) -> Uncertainty:
    """Uncertainty of the values of a fit.

    From the curvature of the fit, or from the variation between windows (sandwich), whichever is
    larger: curvature alone trusts the model to be right. The bias by time steps is extrapolated
    from half the step, for an error in proportion to it (Richardson); half of that is added as
    uncertainty. So is all of the next Gauss-Newton step: it is almost zero at a minimum, but
    contacts make fits of many numbers end before one. If the minimum cost of such a fit is only
    known within a tolerance, its 95 % interval contains all values within that tolerance (profile
    likelihood, linearised).

    Args:
      fitter: of its windows.
      fit: the fit.
      jacobian: computed if not given.
      known_to: possible excess of the cost over its minimum, for values without a prior [sigma^2].
    """
    free = fitter.free(fit.terms)
    columns = fitter.by_value(fit, free)
    jacobian = jacobian or fitter.jacobian(fit)
    projection = Projection.of(fitter, jacobian)
    left, residual = projection(columns), projection(fit.residual[..., None])[:, 0]
    known = np.array([1.0 / f.prior**2 for f in free])
    inverse = np.linalg.pinv(left.T @ left + np.diag(known), rcond=1e-12)
    further = inverse @ (left.T @ residual - known * [f.value(fit.terms) for f in free])
    freedom = max(1.0, fitter.freedom)
    curvature = inverse * max(1.0, float(residual @ residual) / freedom)
    by_window = (left * residual[:, None]).reshape(len(columns), -1, len(free)).sum(axis=1)
    by_window -= by_window.mean(axis=0)
    few = len(columns) / max(1, len(columns) - 1)
    sandwich = inverse @ (few * by_window.T @ by_window) @ inverse
    by_step = HALVINGS * inverse @ (left.T @ projection(fitter.step_error(fit))[:, 0])
    ended = np.where(known == 0.0, known_to, 0.0) / INTERVAL**2 * np.diag(inverse)
    spread = np.maximum.reduce([np.diag(curvature), np.diag(sandwich), ended])
    variance = spread + (by_step / 2) ** 2 + further**2
    unit = np.array([f.unit for f in free])
    return Uncertainty(np.sqrt(variance) * unit, by_step * unit)
