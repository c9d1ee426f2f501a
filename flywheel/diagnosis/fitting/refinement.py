"""Time steps as short as the contacts of each window ask for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.parameters import Free
from flywheel.diagnosis.fitting.stopping import ROUNDS, hopeless

F = TypeVar("F", bound=Fitter)
# Root mean square of what half the time step changes in a window [sigma], above which it is halved: more
# tells in the fit, and contacts in coarse steps make cliffs in its cost that no start gets over.
TOLERATED = 0.3


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
        fit, other = _compared(fitter, fit, finer, in_other_steps(finer, fit, coarse), free)
        if fit.cost <= other.cost:
            break
        back = fitter.fit(in_other_steps(fitter, other, coarse), free, rounds=1)
        if back.cost <= other.cost:
            return fitter, back
        fitter, fit = finer, other
    return fitter, fit


def _compared(
    fitter: Fitter, fit: Fit, finer: Fitter, other: Fit, free: Sequence[Free]
) -> tuple[Fit, Fit]:
    """Both fits, fitted on until the one in shorter steps is better, or clearly will not be.

    Before it is fitted, it is worse: its starts suited the longer steps.
    """
    for _ in range(ROUNDS):
        if not fit.converged:
            fit = fitter.fit(fit, free, rounds=1)
        before, other = other, finer.fit(other, free, rounds=1)
        missing, fell = other.cost - fit.cost, before.cost - other.cost
        if missing < 0.0 or other.converged or hopeless(missing, fell):
            break
    return fit, other


def in_other_steps(fitter: Fitter, fit: Fit, where: np.ndarray) -> Fit:
    """A fit with the time steps of another fitter, which are not the same in windows `where` (K,)."""
    held = None if fit.held is None else fit.held | where
    return replace(fitter.under(fit, fit.terms), held=held)
