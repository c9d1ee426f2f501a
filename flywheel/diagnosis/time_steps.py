"""Time steps as short as the contacts of each window ask for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

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
    that fits better: recordings of a simulation may well have been made in the plant's own.

    Args:
      fit: with sizes of effects `free` or none.
      tolerated: see `TOLERATED`.
    """
    better = True
    while better and (coarse := fitter.coarse(fit, tolerated)).any():
        finer = fitter.refined(coarse)
        held = None if fit.held is None else fit.held | coarse
        other = replace(finer.under(fit, fit.terms), held=held)
        for _ in range(COMPARED):
            if not fit.converged:
                fit = fitter.fit(fit, free, rounds=1)
            other = finer.fit(other, free, rounds=1)
            if better := other.cost < fit.cost:
                fitter, fit = finer, other
                break
    return fitter, fit
