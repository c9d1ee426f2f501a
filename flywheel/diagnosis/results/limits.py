"""What counts as seen, what counts as noise, and the verdict that follows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.checks.adequacy import Adequacy
from flywheel.diagnosis.fitting.network_fit import OwnErrors
from flywheel.diagnosis.results.verdict import Alternative, Verdict
from flywheel.diagnosis.selection.misspecification import OtherLaw
from flywheel.diagnosis.selection.step import Step

THRESHOLD = 25.0  # score from which an effect counts as seen
EQUALLY_GOOD = 10.0  # difference of two criteria (BIC) below which data do not tell
LOUD = 1.05  # variance of what is left from which it is more than noise, were that known exactly
SURE = 2.0  # standard deviations of the noise's own error on top
CORRELATED = 0.05  # correlation from sample to sample, likewise
INCONSTANT = 1.0  # differences of a size between windows, likewise
OTHER = 0.1  # of what an answer and another law explain, that the other one does
MARGIN = 1.5  # times a model's own errors in a few draws, which seldom are the worst of them
OUTSTANDING = 6.0  # standard deviations of noise by which one window may stand out


@dataclass(frozen=True)
class Limits:
    """What counts as seen, and as noise. See the module's constants."""

    threshold: float = THRESHOLD
    equally_good: float = EQUALLY_GOOD
    loud: float = LOUD
    correlated: float = CORRELATED
    inconstant: float = INCONSTANT
    outstanding: float = OUTSTANDING
    other: float = OTHER

    def beyond(self, own: OwnErrors) -> Limits:
        """Where a model's own errors are not taken for more."""
        return replace(
            self,
            threshold=max(self.threshold, MARGIN * own.score),
            loud=self.loud * max(1.0, own.noise),
            correlated=self.correlated + max(0.0, own.correlation),
            outstanding=max(self.outstanding, own.loudest),
        )

    def enough(self, left: Adequacy) -> bool:
        """Nothing but noise is left."""
        return (
            left.noise < self.loud + SURE * left.doubt
            and left.correlation < self.correlated
            and left.loudest < self.outstanding
        )

    def nothing_left(self, left: Adequacy) -> bool:
        """Nothing but noise, by effects that are the same everywhere: there is no place to look for more."""
        return self.enough(left) and self.constant(left)

    def other_form(self, law: OtherLaw) -> bool:
        """What was found has another form than the effects of the library.

        An effect that is there leaves something to another law where the plant has it in a slightly
        other form; but in its place that law would not explain more.
        """
        return self.imitated(law) or (law.score > self.threshold and law.share > self.other)

    def imitated(self, law: OtherLaw) -> bool:
        """An effect of the answer only imitates a law that is none of the library.

        Which explains by so much more that it would have been seen beside the effect.
        """
        return law.gain > self.threshold

    def constant(self, left: Adequacy) -> bool:
        """Fitted sizes are the same everywhere."""
        return left.inconstancy < self.inconstant


def verdict_of(
    limits: Limits,
    last: Step,
    answer: Alternative,
    before: Adequacy,
    after: Adequacy,
    law: OtherLaw,
) -> Verdict:
    """The answer in a word, before it is asked whether others explain the recordings as well.

    Args:
      limits: what counts as seen.
      last: step of the selection.
      answer: of that; empty if nothing was found.
      before, after: what the first and the last model leave.
      law: that explains more than the answer.
    """
    if not np.isfinite(last.fit.cost):
        return Verdict.NOT_CONVERGED
    enough = limits.enough(after) and not limits.other_form(law)
    if not answer:
        if enough:
            smallest = [score.smallest for score in last.scores]
            blind = all(
                size > s.candidate.effect.sizes[0].high
                for size, s in zip(smallest, last.scores, strict=True)
            )
            return Verdict.DATA_INSUFFICIENT if blind else Verdict.NOISE_ONLY
        return Verdict.OUTSIDE_LIBRARY
    # An effect of which nobody can say that it is there, although it explains much, is not the effect.
    if not limits.constant(after) or not all(each.shown for each in answer):
        return Verdict.OUTSIDE_LIBRARY
    if not enough:
        explained = (before.noise - after.noise) / max(before.noise - 1.0, 1e-9)
        partial = explained > 0.5 and not limits.imitated(law)
        return Verdict.PARTIAL if partial else Verdict.OUTSIDE_LIBRARY
    return Verdict.EFFECT
