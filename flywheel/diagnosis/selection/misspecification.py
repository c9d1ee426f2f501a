"""Whether an answer has the right form: what laws of no library explain beside it, or in its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.probes import probed
from flywheel.diagnosis.selection.step import Step
from flywheel.diagnosis.selection.stepwise import Selection


@dataclass(frozen=True)
class OtherLaw:
    """What laws of `probes` explain that an answer does not.

    Attributes:
      name: of the law that explains the most beside it; "" for none.
      score: of that, like a candidate's.
      share: of what both explain, what that explains beside the answer.
      instead: the law that, fitted in the place of an effect of the answer, explains the most; "" if none
        comes near.
      gain: how much better a model with that is (difference of the criteria, BIC).
    """

    name: str = ""
    score: float = 0.0
    share: float = 0.0
    instead: str = ""
    gain: float = -np.inf

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        gain = self.gain if self.instead else None
        return {
            "law": self.name,
            "score": self.score,
            "share": self.share,
            "instead": self.instead,
            "gain": gain,
        }


NONE = OtherLaw()


def other_law(
    selection: Selection, first: Step, last: Step, instead: Sequence[Fit] = ()
) -> OtherLaw:
    """What laws explain that the last step of a selection, which began with the first, does not.

    Args:
      instead: models with a law in the place of an effect of the last step.
    """
    if not last.probes:
        return NONE
    best = max(last.probes, key=lambda score: score.power)
    explained = max(0.0, first.fit.cost - last.fit.cost)
    share = best.power / max(explained + best.power, 1e-9)
    law = OtherLaw(best.candidate.effect.name, best.score, share)
    if not instead:
        return law
    better = min(instead, key=selection.criterion)
    gain = selection.criterion(last.fit) - selection.criterion(better)
    return replace(law, instead=probed(better.terms)[0].effect.name, gain=gain)
