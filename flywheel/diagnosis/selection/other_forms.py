"""Other forms of an identified effect, before a second one is searched for.

Friction that differs between cables leaves a large residual if it is modelled as equal, and so does
friction in proportion to stiffness. A search would name a second effect for it. If an effect leaves
more than noise, it is therefore fitted by other laws of its family, and with a size for each part;
a form that is clearly better, including its penalty, is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.nuisance import as_said
from flywheel.diagnosis.selection.candidates import Candidate, at_parts, families
from flywheel.diagnosis.selection.criterion import Promise, promised
from flywheel.diagnosis.selection.robot_as_built import promised_as_built
from flywheel.diagnosis.selection.score_test import (
    Score,
    ScoredModel,
    further_scores,
    slices_of,
)
from flywheel.diagnosis.selection.search import Search, without
from flywheel.effects import (
    PerPart,
    Term,
    Terms,
    acts_on_same_parts,
    alike,
    at_largest_part,
    at_same_size,
    parts_of,
    per_part_term,
    with_shares,
)


@dataclass(frozen=True)
class _Form:
    """A model with a form of an effect.

    Attributes:
      fit: of it.
      family: of the effect.
    """

    fit: Fit
    family: str

    @property
    def term(self) -> Term:
        """The effect in the model."""
        return _of_family(self.fit, self.family)


def proposed_forms(search: Search, model: ScoredModel) -> list[Term]:
    """Other laws, and effects at one cable or winch alone, that promise clearly more than any candidate.

    Effects at one part alone, which need simulations, are not tested if the best candidate promises
    to explain nearly the whole residual.
    """
    settings, best = search.settings.forms, model.scores[0]
    asked = {each.effect.family for each in search.library}
    forms = [each for each in model.probes if each.candidate.effect.form]
    found = [each for each in forms if each.candidate.effect.family in asked]
    if best.statistic <= settings.enough * model.beyond_noise:
        alone = at_parts(search.fitter.windows.robot, search.library)
        found += further_scores(search.fitter, model.fit, model.test, alone, search.settings.score)
    promising = [s for s in found if s.statistic > settings.more * best.statistic]
    promising.sort(key=lambda each: -each.statistic)
    return [each.candidate.term(each.sizes, each.shape) for each in promising[: settings.rivals]]


def in_other_forms(
    search: Search, before: ScoredModel, model: ScoredModel, rivals: Sequence[Score]
) -> ScoredModel:
    """A model whose new effect has the form that explains clearly more than the others, if any does.

    Args:
      search: that added the effect.
      before: the model without it.
      model: the model with it.
      rivals: further effects that may be the right one if sizes differ from part to part.
    """
    had = {family for family, _ in families(before.fit.terms)}
    new = {family for family, _ in families(model.fit.terms)}
    for family in sorted(new - had):
        model = _in_best_form(search, model, family, rivals)
    return model


def with_even_sizes(search: Search, model: ScoredModel) -> ScoredModel:
    """A model of a robot as built with sizes for each part set to one, if that explains nearly as much.

    They were fitted before the numbers, for which they may have compensated.
    """
    for term in model.fit.terms:
        if isinstance(term.effect, PerPart) and model.fit.kept is not None:
            even = tuple(at_same_size(t) if t is term else t for t in model.fit.terms)
            begun = search.fitter.with_terms(model.fit, as_said(even))
            search.heartbeat(f"fitting {term.effect.name} of one size with numbers as built")
            fit = search.settled(search.effects_first(begun))
            if search.criterion(fit) - search.criterion(model.fit) <= search.threshold:
                model = search.score_all(fit)
    return model


def _in_best_form(
    search: Search, model: ScoredModel, family: str, rivals: Sequence[Score]
) -> ScoredModel:
    if not _seen_beside(search, model):
        return model
    even = [_Form(model.fit, family), *_by_other_laws(search, model, family)]
    even += _rivals_in_place(search, model, family, rivals)
    form = min(even, key=lambda each: search.criterion(each.fit))
    if form.fit is not model.fit:
        model, family = search.score_all(search.settled(form.fit)), form.family
        if not _seen_beside(search, model):
            return model
    heartbeat, sized = search.heartbeat, partial(_per_part, search, model, family)
    uneven = heartbeat.spared(sized, None, f"{family} with a size for each part")
    if uneven is None:
        return model
    tried = partial(_rival_per_part, search, found=uneven)
    forms = [
        uneven,
        *heartbeat.each(tried, rivals, lambda rival: f"{rival.candidate.label} per part"),
    ]
    alone = partial(_at_one_part, search)
    forms += heartbeat.each(alone, forms, lambda form: f"{form.family} at one part")
    best = min((form.fit for form in forms), key=search.criterion)
    gained = search.criterion(model.fit) - search.criterion(best)
    return model if gained <= search.threshold else search.score_all(search.settled(best))


def _seen_beside(search: Search, model: ScoredModel) -> bool:
    """True if an effect is visible on top of a model."""
    return max(each.score for each in (*model.scores, *model.probes)) >= search.threshold


def _of_family(fit: Fit, family: str) -> Term:
    """The effect of a family that a model has."""
    return next(term for term in fit.terms if term.asked and term.effect.family == family)


def _by_other_laws(search: Search, model: ScoredModel, family: str) -> list[_Form]:
    """The model with each other law of a family that explains something in addition, fitted."""
    found, term = [], _of_family(model.fit, family)
    for score in model.probes:
        effect = score.candidate.effect
        other = effect.family == family and effect.name != term.effect.name
        if other and score.score >= search.threshold:
            found += _fitted_in_place(search, model.fit, term, score.candidate)
    return found


def _rivals_in_place(
    search: Search, model: ScoredModel, family: str, rivals: Sequence[Score]
) -> list[_Form]:
    """The model with each rival that is visible in addition to an effect in its place, fitted.

    For a robot as built: the compensation by its numbers was compared using sensitivities of
    another place.
    """
    if model.fit.kept is None:
        return []
    found, term = [], _of_family(model.fit, family)
    seen = {s.candidate.label for s in model.scores if s.score >= search.threshold}
    for candidate in (rival.candidate for rival in rivals):
        if candidate.effect.family != family and candidate.label in seen:
            found += _fitted_in_place(search, model.fit, term, candidate)
    return found


def _fitted_in_place(search: Search, fit: Fit, term: Term, candidate: Candidate) -> list[_Form]:
    """A fit with a candidate in place of a term, fitted as long as it may become better."""
    what = f"{candidate.label} in place of {term.effect.name}"
    search.heartbeat(f"fitting {what}")

    def fitted(candidate: Candidate) -> _Form:
        begun = search.fitter.with_terms(fit, _exchanged(search, fit, term, candidate))
        return _Form(search.fit_until(begun, search.criterion(fit)), candidate.effect.family)

    return search.heartbeat.each(fitted, [candidate], lambda _: what)


def _exchanged(search: Search, fit: Fit, term: Term, candidate: Candidate) -> Terms:
    """Terms of a fit with a candidate in place of one of them, of the sizes with the same change."""
    fitter = search.fitter
    rest = without(fit.terms, term)
    bare = fitter.with_terms(fit, rest)
    units = candidate.unit_terms()
    columns = fitter.columns(bare, [(*rest, each) for each in (term, *units)])
    wanted, own = columns[..., 0].ravel(), columns[..., 1:].reshape(-1, len(units))
    shapes = [own[:, each] for each in slices_of([candidate])[0]]
    sizes = [np.linalg.lstsq(each, wanted, rcond=None)[0] for each in shapes]
    fall = [float(wanted @ each @ size) for each, size in zip(shapes, sizes, strict=True)]
    best = int(np.argmax(fall))  # of the squares of what the term changes
    return (*rest, candidate.term(tuple(sizes[best].tolist()), best))


def _at_one_part(search: Search, found: _Form) -> _Form | None:
    """The model with the effect at its largest part alone, fitted; None if others have much of it."""
    fit, term = found.fit, found.term
    alone, share = at_largest_part(term)
    if share < search.settings.forms.alone:
        return None
    search.heartbeat(f"fitting {term.effect.name} at one {term.effect.part}")
    terms = tuple(alone if each is term else each for each in fit.terms)
    begun = search.fitter.with_terms(fit, terms)
    return _Form(search.fit_until(begun, search.criterion(fit)), found.family)


def promised_per_part(
    search: Search, model: ScoredModel, others: Terms, even: Term
) -> Promise | None:
    """Promise of a model with a size of a term for each part beside others; None if it has no parts."""
    fitter = search.fitter
    term = per_part_term(even, fitter.windows.robot, search.settings.forms.spread)
    if term is None:
        return None
    begun = replace(fitter.with_terms(model.fit, (*others, term)), cache=model.fit.cache)
    return promised(fitter, model, begun)


def _per_part(search: Search, model: ScoredModel, family: str) -> _Form | None:
    """The model with a size of an effect for each part, fitted; None if that promises too little.

    Numbers of a robot as built differ between parts, too: it must promise about as much as they do.
    """
    fit, fitter, spread = model.fit, search.fitter, search.settings.forms.spread
    term = _of_family(fit, family)
    others = without(fit.terms, term)
    promise = promised_per_part(search, model, others, term)
    if promise is None or (promise.explained < search.threshold and term.place is None):
        return None
    numbers, more = promised_as_built(search, model), search.settings.pairs.more
    if numbers is not None and numbers.explained > more * promise.explained:
        return None
    *_, uneven = promise.fit.terms
    search.heartbeat(f"fitting {term.effect.name} {uneven.effect.form}")
    sized = _sized_by_part(fitter, model, term, uneven, spread)
    starts = (promise.fit, fitter.with_terms(fit, (*others, sized)))
    begun = replace(min(starts, key=lambda each: each.cost), cache=fit.cache)
    return _Form(search.fit_until(begun, search.criterion(fit)), family)


def _sized_by_part(
    fitter: Fitter, model: ScoredModel, term: Term, uneven: Term, spread: float
) -> Term:
    """A term with the size at each part from the linearisation of a model."""
    size, *shapes = term.values
    count = len(parts_of(fitter.windows.robot, term.effect.part))
    present = np.ones(count) if term.place is None else np.eye(count)[term.place]
    doubled = [  # at a part, a second term of an effect stands in the place of the first
        (*model.fit.terms, Term(term.effect, place, (size * (1.0 + share), *shapes)))
        for place, share in enumerate(present)
    ]
    columns = model.test.projection(fitter.columns(model.fit, doubled))
    gram = columns.T @ columns + np.eye(count)  # hardly more than the common size
    more = np.linalg.solve(gram, columns.T @ model.test.residual)
    return with_shares(uneven, size * (present + more), spread)


def _rival_per_part(search: Search, score: Score, found: _Form) -> _Form | None:
    """The model with another effect in its place, fitted; None if that has other parts.

    It starts with the same factors: a cable with more friction has more of it by any law.
    """
    fit, fitter, effect = found.fit, search.fitter, score.candidate.effect
    robot = fitter.windows.robot
    if effect.family == found.family or not acts_on_same_parts(effect, found.term, robot):
        return None
    *rest, even = _exchanged(search, fit, found.term, score.candidate)
    other = alike(even, found.term, robot)
    search.heartbeat(f"fitting {other.effect.name} {other.effect.form}")
    begun = fitter.with_terms(fit, (*rest, other))
    most = fitter.settings.stopping.rounds
    return _Form(search.fit_until(begun, search.criterion(fit), most), effect.family)
