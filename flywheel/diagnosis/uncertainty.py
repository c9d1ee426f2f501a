"""How sure fitted values are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.free import Free
from flywheel.diagnosis.score import Projection
from flywheel.records import Floats


def deviations(fitter: Fitter, fit: Fit, free: Sequence[Free]) -> Floats:
    """(n,) standard deviations of fitted values, in their units.

    From the curvature of the fit, or from how much the windows disagree (sandwich), whichever is
    larger: curvature alone trusts the model to be right.
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
    variance = np.maximum(np.diag(curvature), np.diag(sandwich))
    return np.sqrt(variance) * np.array([f.unit for f in free])
