"""Stopping rules: a fit has converged, gains too little per round, or cannot reach its target."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.settings import FitStoppingSettings


def converged(
    before: float, after: float, settings: FitStoppingSettings, enough: float = 0.0
) -> bool:
    """True if a step hardly changed the cost.

    Args:
      before, after: the cost.
      settings: thresholds.
      enough: decrease below which it has converged, too.
    """
    hardly = min(settings.converged_share * before, settings.converged_fall)
    return bool(np.isfinite(before)) and before - after < max(enough, hardly)


def least_worthwhile_fall(cost: float, freedom: float, settings: FitStoppingSettings) -> float:
    """Decrease of the cost worth another round; 0 for a model that may be right.

    A model that is clearly wrong is not fitted to the last digit.

    Args:
      cost: of the fit.
      freedom: its degrees of freedom, the expected cost of noise alone.
      settings: threshold of a clearly wrong model.
    """
    return settings.min_relative_gain * max(0.0, cost - settings.wrong * freedom)


def out_of_reach(missing: float, fell: float, max_rounds: float) -> bool:
    """True if a fit clearly stays above its target, or diverges.

    Args:
      missing: to the target after a round; NaN or infinite for a fit that diverges.
      fell: decrease of the cost in that round.
      max_rounds: allowed number of further such rounds.
    """
    return not missing <= max_rounds * fell
