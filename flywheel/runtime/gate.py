"""Whether a new model may take the champion's place."""

from __future__ import annotations

import math

from flywheel.runtime.config import GateConfig
from flywheel.runtime.measures import Errors, GateDecision, Navigation


def decide_champion(
    config: GateConfig,
    horizon_seconds: float,
    candidate: Errors | None,
    champion: Errors | None,
    navigation: Navigation | None = None,
    champion_navigation: Navigation | None = None,
) -> GateDecision:
    """Compare a candidate with the champion, on the same validation episodes and the same tasks.

    Args:
      config: of the gate.
      horizon_seconds: of the short-horizon errors, for the words [s].
      candidate: errors of the new model; None if it predicts no finite numbers.
      champion: errors of the champion, None for the first model.
      navigation: closed-loop episodes of the candidate, if there were any.
      champion_navigation: those of the champion.
    """
    measure = f"validation e_pos_rmse at {horizon_seconds:g} s [%]"
    number = math.nan if candidate is None else candidate.short.e_pos_rmse
    reference = None if champion is None else champion.short.e_pos_rmse

    def decision(promoted: bool, reason: str) -> GateDecision:
        return GateDecision(
            promoted=promoted, measure=measure, number=number, reference=reference, reason=reason
        )

    if not math.isfinite(number):
        return decision(False, "The model does not predict finite numbers.")
    if reference is None:
        return decision(True, "The first model.")
    if math.isfinite(reference) and number > config.error_ratio * reference:
        return decision(False, f"Its error of {number:.3g} % is above {reference:.3g} %.")
    fall = _success_drop(navigation, champion_navigation)
    if fall > config.success_drop:
        return decision(False, f"Its success rate is {fall:.0%} lower than the champion's.")
    return decision(True, f"Its error of {number:.3g} % beats {reference:.3g} %.")


def _success_drop(new: Navigation | None, old: Navigation | None) -> float:
    if new is None or old is None or not old.success.total:
        return 0.0
    if not new.success.total:
        return 1.0
    return old.success.rate - new.success.rate
