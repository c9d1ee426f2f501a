"""Acceptance of a new model as champion."""

from __future__ import annotations

import math

import numpy as np

from flywheel.evaluation import Interval, rmse_ratio_interval
from flywheel.results import Errors, GateDecision, Navigation
from flywheel.runtime.config.parts import GateConfig

RESAMPLING_SEED = 0


def decide_champion(
    config: GateConfig,
    horizon_seconds: float,
    candidate: Errors | None,
    champion: Errors | None,
    navigation: Navigation | None = None,
    champion_navigation: Navigation | None = None,
    same: bool = False,
) -> GateDecision:
    """Compare a candidate with the champion, on the same validation episodes and the same tasks.

    The candidate was trained on more data. It is rejected only if its error is higher by more than
    chance explains with so few validation episodes, or if it reaches fewer goals.

    Args:
      config: of the gate.
      horizon_seconds: of the short-horizon errors, for the message [s].
      candidate: errors of the new model; None if its predictions are not finite.
      champion: errors of the champion, None for the first model.
      navigation: closed-loop episodes of the candidate, if there were any.
      champion_navigation: those of the champion.
      same: True if the candidate has the champion's weights.
    """
    measure = f"validation e_pos_rmse at {horizon_seconds:g} s [%]"
    number = math.nan if candidate is None else candidate.short.e_pos_rmse
    reference = None if champion is None else champion.short.e_pos_rmse
    ratio = _ratio(candidate, champion)

    def decision(promoted: bool, reason: str) -> GateDecision:
        return GateDecision(
            promoted=promoted,
            measure=measure,
            number=number,
            reference=reference,
            ratio=None if ratio is None else ratio.value,
            low=None if ratio is None else ratio.low,
            high=None if ratio is None else ratio.high,
            reason=reason,
        )

    if same:
        return decision(False, "Training found no better weights than the champion's.")
    if not math.isfinite(number):
        return decision(False, "The model does not predict finite numbers.")
    if reference is None:
        return decision(True, "The first model.")
    if not math.isfinite(reference):
        return decision(True, "The champion no longer predicts finite numbers.")
    least = number / reference if ratio is None else ratio.low
    words = f"Its error of {number:.3g} %" + _in_words(ratio)
    if least > config.error_ratio:
        return decision(False, f"{words} is above the champion's {reference:.3g} %.")
    fall = _success_drop(navigation, champion_navigation)
    if fall > config.success_drop:
        return decision(False, f"Its success rate is {fall:.0%} lower than the champion's.")
    return decision(True, f"{words} {_verb(number, reference, ratio)} {reference:.3g} %.")


def _verb(number: float, reference: float, ratio: Interval | None) -> str:
    """A promoted model's error relative to the champion's, in words."""
    if number >= reference:
        return "is not clearly above the champion's"
    sure = ratio is None or ratio.high < 1.0
    return "beats the champion's" if sure else "is below the champion's, but not clearly"


def _ratio(candidate: Errors | None, champion: Errors | None) -> Interval | None:
    """The candidate's error over the champion's, with its interval; None for too few episodes."""
    if candidate is None or champion is None:
        return None
    names = sorted(candidate.by_episode.keys() & champion.by_episode.keys())
    new, old = (np.array([e.by_episode[name] for name in names]) for e in (candidate, champion))
    if len(names) < 2 or not (np.isfinite([new, old]).all() and (old > 0).all()):
        return None
    return rmse_ratio_interval(new, old, RESAMPLING_SEED)


def _in_words(ratio: Interval | None) -> str:
    if ratio is None:
        return ""
    return f" ({ratio.value:.2f} times, 95 % interval {ratio.low:.2f} to {ratio.high:.2f})"


def _success_drop(new: Navigation | None, old: Navigation | None) -> float:
    if new is None or old is None or not old.success.total:
        return 0.0
    if not new.success.total:
        return 1.0
    return old.success.rate - new.success.rate
