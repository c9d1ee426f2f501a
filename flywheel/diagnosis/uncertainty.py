"""How sure fitted values are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.free import Free
from flywheel.diagnosis.score import Projection
from flywheel.records import Floats

AT_ONCE = 2.0  # 1 + 1/2 + 1/4 + ...: all further halvings of the step together


def deviations(fitter: Fitter, fit: Fit, free: Sequence[Free]) -> Floats:
    """(n,) standard deviations of fitted values, in their units.

    From the curvature of the fit, or from how much the windows disagree (sandwich), whichever is
    larger: curvature alone trusts the model to be right. What the plant's time step does to the values
    is added: an error that falls with the step, as `AT_ONCE` times what half the step would change.
    """
    moves = np.array([f.step_from(fit.terms) for f in free])
    stepped = [f.moved(fit.terms, move) for f, move in zip(free, moves, strict=True)]
    columns = fitter.columns(fit, stepped) / moves
    weights = np.ones(len(columns))
    projection = Projection.of(fitter, fitter.linear(fit), None, weights)
    left, residual = projection(columns), projection(fit.residual[..., None])[:, 0]
    gram = left.T @ left
    inverse = np.linalg.pinv(gram, rcond=1e-12)
    freedom = max(1, len(residual) - fit.change.size)
    curvature = inverse * max(1.0, float(residual @ residual) / freedom)
    by_window = (left * residual[:, None]).reshape(len(columns), -1, len(free)).sum(axis=1)
    by_window -= by_window.mean(axis=0)
    few = len(columns) / max(1, len(columns) - 1)
    sandwich = inverse @ (few * by_window.T @ by_window) @ inverse
    by_numbers = inverse @ (left.T @ projection(fitter.step_error(fit))[:, 0])
    variance = np.maximum(np.diag(curvature), np.diag(sandwich)) + (AT_ONCE * by_numbers) ** 2
    return np.sqrt(variance) * np.array([f.unit for f in free])
