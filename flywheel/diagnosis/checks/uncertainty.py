"""How sure fitted values are, and how far the plant's time step pushes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.fitting.jacobian_cache import Linear
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.parameters import Free
from flywheel.diagnosis.selection.score_test import Projection
from flywheel.records import Floats

HALVINGS = (
    2.0  # 1 + 1/2 + 1/4 + ...: what all further halvings of the step change, over what one does
)


@dataclass(frozen=True)
class Uncertainty:
    """Of n fitted values, in their units.

    Attributes:
      deviations: (n,) standard deviations of the values without `by_step`.
      by_step: (n,) what the plant's time step adds to the values. A plant with long steps fits best with
        values that make up for them; those of the robot are without.
    """

    deviations: Floats
    by_step: Floats


def uncertainty(
    fitter: Fitter, fit: Fit, free: Sequence[Free], linear: Linear | None = None
) -> Uncertainty:
    """Of the values of a fit, whose sensitivities `linear` are computed where they are not at hand.

    From the curvature of the fit, or from how much the windows disagree (sandwich), whichever is
    larger: curvature alone trusts the model to be right. What time steps add is extrapolated from half
    the step, for an error in proportion to it (Richardson); half of that again is doubted.
    """
    columns = fitter.by_size(fit, free)
    projection = Projection.of(fitter, linear or fitter.linear(fit), None, np.ones(len(columns)))
    left, residual = projection(columns), projection(fit.residual[..., None])[:, 0]
    known = np.diag([1.0 / f.prior**2 for f in free])
    inverse = np.linalg.pinv(left.T @ left + known, rcond=1e-12)
    freedom = max(1, int(np.isfinite(fitter.windows.measured).sum()) - fit.change.size)
    curvature = inverse * max(1.0, float(residual @ residual) / freedom)
    by_window = (left * residual[:, None]).reshape(len(columns), -1, len(free)).sum(axis=1)
    by_window -= by_window.mean(axis=0)
    few = len(columns) / max(1, len(columns) - 1)
    sandwich = inverse @ (few * by_window.T @ by_window) @ inverse
    by_step = HALVINGS * inverse @ (left.T @ projection(fitter.step_error(fit))[:, 0])
    variance = np.maximum(np.diag(curvature), np.diag(sandwich)) + (by_step / 2) ** 2
    unit = np.array([f.unit for f in free])
    return Uncertainty(np.sqrt(variance) * unit, by_step * unit)
