"""Step refinement: time steps as short as the contacts of each window require."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.parameters import FreeParameter
from flywheel.diagnosis.fitting.stopping import out_of_reach

F = TypeVar("F", bound=Fitter)


def shorter_steps(
    fitter: F, fit: Fit, free: Sequence[FreeParameter] = (), tolerated: float | None = None
) -> tuple[F, Fit]:
    """A fitter with sufficiently short steps for a model, and its fit; the same two if they are
    short enough.

    A plant's own may be too coarse when caps hit the ground. Shorter ones are used if they fit
    better: recordings of a simulation may have been made in the plant's own. Better initial states
    found on the way are no evidence for shorter steps: longer ones are tried from there, too.

    Args:
      fitter: of the model.
      fit: with values of effects `free` or none.
      free: see `fit`.
      tolerated: allowed change by half the time step in a window [sigma]; None for the settings'.
    """
    if tolerated is None:
        tolerated = fitter.settings.refinement.tolerated
    while (finer := fitter.finer(fit, tolerated)) is not None:
        coarse = finer.time_steps != fitter.time_steps
        fit, other = _compared(fitter, fit, finer, in_other_steps(finer, fit, coarse), free)
        if fit.cost <= other.cost:
            break
        back = fitter.fit(in_other_steps(fitter, other, coarse), free, rounds=1)
        if back.cost <= other.cost:
            return fitter, back
        fitter, fit = finer, other
    return fitter, fit


def _compared(
    fitter: Fitter, fit: Fit, finer: Fitter, other: Fit, free: Sequence[FreeParameter]
) -> tuple[Fit, Fit]:
    """Both fits, continued until the one in shorter steps is better, or clearly will not be.

    Before it is fitted, it is worse: its initial states suited the longer steps.
    """
    stopping = fitter.settings.stopping
    for _ in range(stopping.rounds):
        if not fit.converged:
            fit = fitter.fit(fit, free, rounds=1)
        before, other = other, finer.fit(other, free, rounds=1)
        missing, fell = other.cost - fit.cost, before.cost - other.cost
        if (
            missing < 0.0
            or other.converged
            or out_of_reach(missing, fell, stopping.max_rounds_to_target)
        ):
            break
    return fit, other


def in_other_steps(fitter: Fitter, fit: Fit, where: np.ndarray) -> Fit:
    """A fit with the time steps of another fitter, which differ in windows `where` (K,)."""
    return fitter.with_terms(fit, fit.terms).outdated(where)
