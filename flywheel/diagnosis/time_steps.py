"""Time steps as short as the contacts of each window ask for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.free import Free

F = TypeVar("F", bound=Fitter)
# Root mean square of what half the time step changes in a window [sigma], above which it is halved: more
# tells in the fit, and contacts in coarse steps make cliffs in its cost that no start gets over.
TOLERATED = 0.3
COMPARED = 2  # rounds of a fit in which halved steps must win


def shorter_steps(
    fitter: F, fit: Fit, free: Sequence[Free] = (), tolerated: float = TOLERATED
) -> tuple[F, Fit]:
    """A fitter with steps that will do for a model, and its fit; the same two where they do already.

    A plant's own may be too coarse where caps hit the ground. What it does in shorter ones is taken where
    that fits better: recordings of a simulation may well have been made in the plant's own. Better starts
    that were found on the way are no evidence for shorter steps: longer ones are tried from there, too.

    Args:
      fit: with sizes of effects `free` or none.
      tolerated: see `TOLERATED`.
    """
    while (coarse := fitter.coarse(fit, tolerated)).any():
        finer = fitter.refined(coarse)
        other = _under(finer, fit, coarse)
        for _ in range(COMPARED):
            if not fit.converged:
                fit = fitter.fit(fit, free, rounds=1)
            other = finer.fit(other, free, rounds=1)
            if other.cost < fit.cost:
                break
        else:
            break
        back = fitter.fit(_under(fitter, other, coarse), free, rounds=1)
        if back.cost <= other.cost:
            return fitter, back
        fitter, fit = finer, other
    return fitter, fit


def _under(fitter: Fitter, fit: Fit, where: np.ndarray) -> Fit:
    """A fit with the time steps of another fitter, which are not the same in windows `where` (K,)."""
    held = None if fit.held is None else fit.held | where
    return replace(fitter.under(fit, fit.terms), held=held)
