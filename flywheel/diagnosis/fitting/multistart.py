"""Other starts for windows that got stuck, if starts are what is wrong with a model."""

from __future__ import annotations

from flywheel.diagnosis.fitting.least_squares import STUCK, Fit, Fitter
from flywheel.diagnosis.fitting.stopping import worth_a_round

EASED = 0.2  # of what makes a window loud, that goes with another start if its start is to blame


def begun_elsewhere(fitter: Fitter, fit: Fit, seed: int = 0) -> Fit:
    """A fit in which windows that got stuck begin elsewhere; of a clearly wrong model only as `eased`."""
    if worth_a_round(fitter, fit):
        return eased(fitter, fit, seed)
    return fitter.elsewhere(fit, seed)


def eased(
    fitter: Fitter, fit: Fit, seed: int = 0, stuck: float = STUCK, usual: float | None = None
) -> Fit:
    """A fit in which windows that got stuck begin elsewhere, see `Fitter.elsewhere`; or the fit itself.

    That is, unless the loudest one is hardly less so from anywhere else: then starts are not what is wrong,
    and the others are not tried, which takes long.
    """
    begun = fitter.elsewhere(fit, seed, stuck, usual, most=1)
    before, after = fitter.mean_squares(fit), fitter.mean_squares(begun)
    if (before - after).max() <= EASED * max(0.0, before.max() - 1.0):
        return fit
    return fitter.elsewhere(begun, seed, stuck, usual)
