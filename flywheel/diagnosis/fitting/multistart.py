"""Other initial states for stuck windows, if these are the fault of a model."""

from __future__ import annotations

from dataclasses import replace

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Restart

# Fraction of a window's excess that must disappear with another state if its state is to blame.
EASED = 0.2
BEFORE, AFTER = 2, 4  # rounds of a fit before windows start elsewhere, and after


def unstuck(fitter: Fitter, fit: Fit, restart: Restart = Restart()) -> Fit:
    """A fit in which stuck windows start elsewhere; with restrictions for a clearly wrong model."""
    if fitter.worthwhile(fit):
        return restarted_with_care(fitter, fit, restart)
    return fitter.restarted(fit, restart)


def restarted_where_loud(fitter: Fitter, fit: Fit, seed: int) -> Fit:
    """A fit in which every window with a residual above noise starts elsewhere, if that helps.

    Args:
      fitter: of the windows.
      fit: of the assessed model: a stuck window is not its error.
      seed: of the model under test; other initial states are drawn than before.
    """
    restart = Restart(seed + 1, stuck=fitter.settings.stopping.wrong, usual=1.0)
    return restarted_with_care(fitter, fit, restart)


def restarted_with_care(fitter: Fitter, fit: Fit, restart: Restart) -> Fit:
    """A fit in which stuck windows start elsewhere, or the fit itself.

    If the worst window hardly improves from any other start, initial states are not the fault, and
    the other windows are not tried, which takes long.
    """
    begun = fitter.restarted(fit, replace(restart, most=1))
    before, after = fitter.mean_squares(fit), fitter.mean_squares(begun)
    least = EASED * max(0.0, before.max() - 1.0)
    if (before - after).max() <= least:
        return fit
    return fitter.restarted(begun, restart)
