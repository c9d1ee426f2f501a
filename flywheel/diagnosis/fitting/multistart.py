"""Other initial states for windows that are stuck, if these are what is wrong with a model."""

from __future__ import annotations

from dataclasses import replace

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Restart


def restarted(fitter: Fitter, fit: Fit, restart: Restart = Restart()) -> Fit:
    """A fit in which windows that are stuck begin elsewhere; of a clearly wrong model with care."""
    if fitter.worthwhile(fit):
        return restarted_with_care(fitter, fit, restart)
    return fitter.restarted(fit, restart)


def restarted_with_care(fitter: Fitter, fit: Fit, restart: Restart) -> Fit:
    """A fit in which windows that are stuck begin elsewhere, or the fit itself.

    If the loudest window is hardly less so from anywhere else, initial states are not what is wrong, and
    the other windows are not tried, which takes long.
    """
    begun = fitter.restarted(fit, replace(restart, most=1))
    before, after = fitter.mean_squares(fit), fitter.mean_squares(begun)
    least = fitter.settings.multistart.eased * max(0.0, before.max() - 1.0)
    if (before - after).max() <= least:
        return fit
    return fitter.restarted(begun, restart)
