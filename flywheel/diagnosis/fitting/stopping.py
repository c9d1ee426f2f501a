"""When a fit stops: it has converged, it is not worth another round, or its target is out of reach."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.settings import FitStoppingSettings


def converged(
    before: float, after: float, settings: FitStoppingSettings, enough: float = 0.0
) -> bool:
    """Whether a step hardly changed the cost.

    Args:
      before, after: the cost.
      settings: its falls that count as hardly.
      enough: fall below which it has converged, too.
    """
    hardly = min(settings.converged_share * before, settings.converged_fall)
    return bool(np.isfinite(before)) and before - after < max(enough, hardly)


def least_worthwhile_fall(cost: float, freedom: float, settings: FitStoppingSettings) -> float:
    """Fall of the cost that is worth another round; 0 for a model that may be right.

    A model that is clearly wrong is not fitted to the last digit.

    Args:
      cost: of the fit.
      freedom: its degrees of freedom, which noise alone would cost.
      settings: what is clearly wrong.
    """
    return settings.min_relative_gain * max(0.0, cost - settings.wrong * freedom)


def out_of_reach(missing: float, fell: float, max_rounds: float) -> bool:
    """Whether a fit clearly stays above its target, or diverges.

    Args:
      missing: to the target after a round; NaN or infinite for a fit that diverges.
      fell: what the cost fell by in that round.
      max_rounds: further rounds like that one that are allowed for.
    """
    return not missing <= max_rounds * fell
