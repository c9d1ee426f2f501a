"""Misspecification tests: the form of an answer is tested against laws outside the library.

A cable whose damping grows with the square of its speed is well imitated by linear damping: the
residual is small, and the fit looks right. Scoring the square directly reveals it. A probe is such
a law: it is scored like a candidate, and never an answer. If one explains much in addition to the
answer, or more in its place, the answer has the wrong form.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.scores import Score
from flywheel.effects import PROBES, Effect, Terms


def is_probe(effect: Effect) -> bool:
    """True for a probe, with any sizes of parts, False for one of the library's effects."""
    return effect.name in PROBES


def probed(terms: Terms) -> Terms:
    """Those of them that are probes."""
    return tuple(term for term in terms if is_probe(term.effect))


@dataclass(frozen=True)
class Misspecification:
    """Explanation by probes that an answer lacks.

    Attributes:
      name: of the law that explains the most in addition to it; "" for none.
      score: of that, like a candidate's.
      share: of it in the explanation by both.
      instead: the law that, fitted in place of an effect of the answer, explains the most; "" if
        none comes near.
      gain: improvement of the model by that (difference of the criteria, BIC).
    """

    name: str = ""
    score: float = 0.0
    share: float = 0.0
    instead: str = ""
    gain: float = -np.inf

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        known = {"law": self.name, "score": self.score, "share": self.share}
        return {**known, "instead": self.instead, "gain": self.gain if self.instead else None}


NONE = Misspecification()


def misspecification(
    first: Fit,
    last: Fit,
    probes: Sequence[Score],
    instead: Sequence[Fit],
    criterion: Callable[[Fit], float],
) -> Misspecification:
    """Laws that explain more than the last model of a search.

    They are the probes scored on top of it, and those of the models that have one `instead` of an effect.
    """
    if not probes:
        return NONE
    best = max(probes, key=lambda score: score.statistic)
    explained = max(0.0, first.cost - last.cost)
    share = best.statistic / max(explained + best.statistic, 1e-9)
    law = Misspecification(best.candidate.effect.name, best.score, share)
    if not instead:
        return law
    better = min(instead, key=criterion)
    gain = criterion(last) - criterion(better)
    return replace(law, instead=probed(better.terms)[0].effect.name, gain=gain)
