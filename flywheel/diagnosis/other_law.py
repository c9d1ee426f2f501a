"""Whether an answer has the right form: what a law that is none of the library explains beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flywheel.diagnosis.selection import Step


@dataclass(frozen=True)
class OtherLaw:
    """The law that explains the most beside an answer, of those in `probes`.

    Attributes:
      name: of it; "" for none.
      score: like a candidate's.
      share: of what both explain, what it explains beside the answer.
      leads: alone it would have explained more than any effect.
    """

    name: str = ""
    score: float = 0.0
    share: float = 0.0
    leads: bool = False

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {"law": self.name, "score": self.score, "share": self.share}


NONE = OtherLaw()


def other_law(first: Step, last: Step) -> OtherLaw:
    """On top of the last step of a selection, which began with the first."""
    if not last.probes:
        return NONE
    best = max(last.probes, key=lambda score: score.power)
    name = best.candidate.effect.name
    alone = next(s.power for s in first.probes if s.candidate == best.candidate)
    explained = max(0.0, first.fit.cost - last.fit.cost)
    share = best.power / max(explained + best.power, 1e-9)
    return OtherLaw(name, best.score, share, leads=alone > first.scores[0].power)
