"""Other models that explain the data as well: effects and laws in the place of those that were found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.stopping import HOPE
from flywheel.diagnosis.selection.deduplication import places, same_place
from flywheel.diagnosis.selection.probes import probed
from flywheel.diagnosis.selection.score_test import Score
from flywheel.diagnosis.selection.step import Step
from flywheel.diagnosis.selection.stepwise import SHORTLIST, Selection, without
from flywheel.effects import Term

RIVAL = 0.8  # share of an effect's power from which another is tried in its place
PATIENCE = 40.0  # `HOPE` for a law: one that is given up too early is an effect wrongly named


@dataclass(frozen=True)
class Exchange:
    """What came of a model whose effects were exchanged for others.

    Attributes:
      last: the model, perhaps with better starts.
      others: models that explain the data as well.
      without: effect that was exchanged, and the model without it.
    """

    last: Fit
    others: tuple[Fit, ...]
    without: tuple[tuple[Term, Step], ...]

    def shorter(self, selection: Selection) -> Step | None:
        """The model without the least needed effect of several, if that does nearly as well."""
        if len(self.without) < 2:
            return None
        term, step = min(
            self.without, key=lambda each: selection.share(self.last, each[1].fit, each[0])
        )
        return step if selection.share(self.last, step.fit, term) <= 1.0 else None


def exchanged(selection: Selection, steps: Sequence[Step], margin: float) -> Exchange:
    """The last model of a selection, and those that explain the data as well.

    Each of its effects is exchanged for others, and for probes, that scored nearly as well in its place.
    A model that is better may have found better starts only: the last one is then fitted from them, too.

    Args:
      selection: that made the steps.
      steps: the last one's model is meant.
      margin: difference of the criteria up to which a model is as good.
    """
    last = steps[-1].fit
    found: list[Fit] = []
    shorter: list[tuple[Term, Step]] = []
    for term in selection.new(steps):
        step = _without(selection, steps, term)
        shorter.append((term, step))
        least = RIVAL * max(s.power for s in step.scores if same_place(s, term))
        for scores in (step.scores, step.probes):
            near = [s for s in scores if s.power > least and not same_place(s, term)]
            found += _in_place(selection, last, term, near, margin)
    for fit in found:
        if selection.criterion(fit) < selection.criterion(last):
            last = _from_its_starts(selection, last, fit)
    return Exchange(last, tuple(found), tuple(shorter))


def _without(selection: Selection, steps: Sequence[Step], term: Term) -> Step:
    """The last model without a term: a step before it, where one was that model already."""
    *earlier, last = steps
    left = places(without(last.fit.terms, term))
    for step in reversed(earlier):
        if places(step.fit.terms) == left:
            return step
    return selection.look(selection.dropped(last.fit, term))


def _in_place(
    selection: Selection, last: Fit, term: Term, scores: Sequence[Score], margin: float
) -> list[Fit]:
    """Models with a candidate in the place of a term that are as good."""
    others, limit = without(last.terms, term), selection.criterion(last) + margin
    found: list[Fit] = []
    known = [(last, term)]
    for score in scores:
        if len(found) >= SHORTLIST:
            break
        twins = (_twin(selection, fit, its, score) for fit, its in known)
        fit = next((twin for twin in twins if twin is not None), None)
        if fit is None:
            terms = (*others, score.candidate.term(score.sizes, score.shape))
            begun = selection.fitter.under(last, terms)
            fit = selection.pursued(begun, limit, PATIENCE if probed(terms) else HOPE)
            known.append((fit, fit.terms[-1]))
        if selection.criterion(fit) < limit:
            found.append(fit)
    return found


def _twin(selection: Selection, fit: Fit, term: Term, score: Score) -> Fit | None:
    """The model with a candidate in the place of a term, and its values, if that predicts the same.

    Two fits of one model differ by more than a margin may be; twins need none.
    """
    effect, place = score.candidate.effect, score.candidate.place
    if len(effect.parameters) != len(term.values) or not score.candidate.allows(term.values):
        return None
    terms = (*without(fit.terms, term), Term(effect, place, term.values))
    twin = selection.fitter.under(fit, terms)
    return twin if abs(twin.cost - fit.cost) < 1e-6 * fit.cost else None


def _from_its_starts(selection: Selection, fit: Fit, other: Fit) -> Fit:
    """A fit, where another model's starts suit its windows better, begun from those."""
    begun = selection.fitter.under(other, fit.terms)
    return selection.combined(fit, selection.pursued(begun, selection.criterion(fit)))
