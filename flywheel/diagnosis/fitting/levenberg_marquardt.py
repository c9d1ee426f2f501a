"""A step of Levenberg and Marquardt's within bounds."""

from __future__ import annotations

import numpy as np

from flywheel.records import Floats


def damped_step(matrix: Floats, pull: Floats, damping: float, bounds: Floats) -> Floats:
    """(S,) step of Marquardt's with normal equations (S, S), (S,), within bounds (2, S).

    What would leave them goes to the bound, and the others take what suits them then.
    """
    if np.isinf(damping):
        return np.zeros_like(pull)
    damped = matrix + np.diag((damping + 1e-9) * np.diag(matrix) + 1e-12)
    step = np.linalg.solve(damped, pull)
    within = np.clip(step, *bounds)
    free = step == within
    if not free.all():
        left = pull[free] - damped[np.ix_(free, ~free)] @ within[~free]
        within[free] = np.linalg.solve(damped[np.ix_(free, free)], left)
    return np.clip(within, *bounds)
