"""Alternative models: other effects and laws in place of those of the answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.candidates import places
from flywheel.diagnosis.selection.misspecification import probed
from flywheel.diagnosis.selection.scores import Linearised, Score, ScoredModel
from flywheel.diagnosis.selection.search import Search, added, without
from flywheel.effects import Term, alike

TWINS = 1e-6  # relative difference of the costs of models that predict the same: rounding


@dataclass(frozen=True)
class ExchangedModels:
    """Result for a model with replaced effects.

    Attributes:
      last: the model, perhaps with better initial states.
      others: equally good models.
      without: each replaced effect, and the model without it.
    """

    last: Fit
    others: tuple[Fit, ...]
    without: tuple[tuple[Term, ScoredModel], ...]

    def shorter(self, search: Search) -> ScoredModel | None:
        """The model without the least necessary effect, if that is nearly as good.

        Without a single effect that is the initial model, which was fitted carefully before any
        effect; except with numbers of a robot as built.
        """
        if len(self.without) < (1 if self.last.kept else 2):
            return None
        term, model = min(
            self.without, key=lambda each: search.share(self.last, each[1].fit, each[0])
        )
        return model if search.share(self.last, model.fit, term) <= 1.0 else None


def exchanged(
    search: Search, models: Sequence[ScoredModel], only_twins: bool = False
) -> ExchangedModels:
    """The last model of a search, and equally good alternatives; `only_twins` predict the same as it.

    Each of its effects is replaced by others, and by probes, that scored nearly as well in its
    place. A better model may only have found better initial states: the last one is then fitted
    from them, too.
    """
    margin = search.limits.equally_good
    last = models[-1].fit
    found: list[Fit] = []
    shorter: list[tuple[Term, ScoredModel]] = []
    for term in added(models):
        model = search.scored(model_without(search, models[:-1], last, [term]))
        shorter.append((term, model))
        least = search.settings.rival * _own_statistic(model, term)
        for scores in (model.scores, model.probes):
            near = [s for s in scores if s.statistic > least and not s.proposes(term)]
            found += _in_place(search, last, term, near, margin, only_twins)
    for fit in found:
        if search.criterion(fit) < search.criterion(last):
            begun = search.refitted(fit, last.terms, search.criterion(last))
            last = search.fit_until(search.fitter.best_of(last, begun))
    return ExchangedModels(last, tuple(found), tuple(shorter))


def _own_statistic(model: ScoredModel, term: Term) -> float:
    """Promise of a term on a model; for one at a part alone, that of its effect everywhere."""
    scores, family = (*model.scores, *model.probes), term.effect.family
    own = [s.statistic for s in scores if s.proposes(term)]
    everywhere = [s.statistic for s in scores if s.candidate.effect.family == family]
    return max(own, default=0.0) or max(everywhere, default=0.0)


def model_without(
    search: Search,
    known: Sequence[Linearised],
    fit: Fit,
    terms: Sequence[Term],
    target: float | None = None,
) -> Linearised:
    """A fit without some of its terms: one of the known models, if possible.

    With a target, the criterion from which on the model would be as good, one that was abandoned when it
    was clearly not the best is fitted further: to its end; or, with numbers of a robot as built, whose
    fits take a minute, until it clearly stays above the target.
    """
    rest = tuple(term for term in fit.terms if term not in terms)
    model = next((m for m in reversed(known) if places(m.fit.terms) == places(rest)), None)
    if model is not None:
        less = model.fit
    elif len(terms) == 1:
        less = search.dropped(fit, terms[0])
    else:
        less = search.refitted(fit, rest)
    if target is not None and less.terms:
        less = search.fit_until(less) if less.kept is None else search.settled(less, target)
    return search.linearised(less) if model is None or less is not model.fit else model


def _in_place(
    search: Search,
    last: Fit,
    term: Term,
    scores: Sequence[Score],
    margin: float,
    only_twins: bool,
) -> list[Fit]:
    """Equally good models with a candidate in place of a term."""
    others, limit = without(last.terms, term), search.criterion(last) + margin
    found: list[Fit] = []
    known = [(last, term)]

    def fitted(score: Score) -> Fit | None:
        twins = (_twin(search, fit, its, score) for fit, its in known)
        twin = next((each for each in twins if each is not None), None)
        if twin is not None or only_twins:
            return twin
        terms = (*others, alike(score.term, term, search.fitter.windows.robot))
        most = search.fitter.settings.stopping.rounds if probed(terms) else None
        fit = search.refitted(last, terms, limit, most)
        known.append((fit, fit.terms[-1]))
        return fit

    for score in scores:
        if len(found) >= search.settings.shortlist:
            break
        what = f"{score.candidate.label} in place of {term.effect.name}"
        fit = search.heartbeat.spared(partial(fitted, score), None, what)
        if fit is not None and search.criterion(fit) < limit:
            found.append(fit)
    return found


def _twin(search: Search, fit: Fit, term: Term, score: Score) -> Fit | None:
    """The model with a candidate in place of a term, and its values, if that predicts the same.

    Two fits of one model may differ by more than a margin; twins need none.
    """
    candidate, values = score.candidate, term.values
    if len(candidate.effect.parameters) != len(values) or not candidate.allows(values):
        return None
    twin_term = Term(candidate.effect, candidate.place, values)
    twin = search.fitter.with_terms(fit, (*without(fit.terms, term), twin_term))
    return twin if abs(twin.cost - fit.cost) < TWINS * fit.cost else None
