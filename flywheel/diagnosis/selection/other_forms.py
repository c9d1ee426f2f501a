"""Other forms of an identified effect, before a second one is searched for.

Friction that differs between cables leaves a large residual if it is modelled as equal, and so does
friction in proportion to stiffness. A search would name a second effect for it. If an effect leaves
more than noise, it is therefore fitted by other laws of its family, and with a size for each part;
a form that is clearly better, including its penalty, is used. A fit with a form has it as its last term.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.selection.candidates import Candidate, families
from flywheel.diagnosis.selection.criterion import Promise, promised
from flywheel.diagnosis.selection.scores import Score, ScoredModel, slices_of
from flywheel.diagnosis.selection.search import Search, without
from flywheel.effects import (
    Term,
    Terms,
    acts_on_same_parts,
    alike,
    at_largest_part,
    parts_of,
    per_part_term,
    with_shares,
)

# Standard deviation of the logarithm of the ratio between parts: most are within a factor of two.
SPREAD = 0.5
# Smallest share of the largest part in the sum over all, for trying the effect there alone; factors are drawn
# to one, so that those of the others do not vanish.
ALONE = 0.4


def in_other_forms(
    search: Search, before: ScoredModel, model: ScoredModel, rivals: Sequence[Score]
) -> ScoredModel:
    """A model whose new effect has the form that explains clearly more than the others, if any does.

    The rivals are further effects that may be the right one if sizes differ from part to part.
    """
    had = {family for family, _ in families(before.fit.terms)}
    new = {family for family, _ in families(model.fit.terms)}
    for family in sorted(new - had):
        model = _in_best_form(search, model, family, rivals)
    return model


def _in_best_form(
    search: Search, model: ScoredModel, family: str, rivals: Sequence[Score]
) -> ScoredModel:
    if not _seen_beside(search, model):
        return model
    heartbeat, term = search.heartbeat, _of_family(model.fit, family)
    tried = partial(_fitted_in_place, search, model.fit, term)
    others = _others_in_place(search, model, term, rivals)
    even = heartbeat.each(tried, others, lambda each: f"fitting {each.label} in place of {family}")
    form = min((model.fit, *even), key=search.criterion)
    if form is not model.fit:
        model, family = search.score_all(search.settled(form)), form.terms[-1].effect.family
        if not _seen_beside(search, model):
            return model
    sized = partial(_per_part, search, model, family)
    uneven = heartbeat.spared(sized, None, f"{family} with a size for each part")
    if uneven is None:
        return model
    same = partial(_rival_per_part, search, uneven)
    forms = [
        uneven,
        *heartbeat.each(same, rivals, lambda each: f"fitting {each.candidate.label} per part"),
    ]
    alone = partial(_at_one_part, search)
    forms += heartbeat.each(
        alone, forms, lambda each: f"fitting {each.terms[-1].effect.name} at one part"
    )
    best = min(forms, key=search.criterion)
    gained = search.criterion(model.fit) - search.criterion(best)
    return model if gained <= search.threshold else search.score_all(search.settled(best))


def _seen_beside(search: Search, model: ScoredModel) -> bool:
    """True if an effect is visible on top of a model."""
    return max(each.score for each in (*model.scores, *model.probes)) >= search.threshold


def _of_family(fit: Fit, family: str) -> Term:
    """The effect of a family that a model has."""
    return next(term for term in fit.terms if term.asked and term.effect.family == family)


def _others_in_place(
    search: Search, model: ScoredModel, term: Term, rivals: Sequence[Score]
) -> list[Candidate]:
    """Laws and effects that are visible on top of an effect, to be fitted in its place.

    Other laws of its family; and rivals for a robot as built: the compensation by its numbers was
    compared using sensitivities of another place.
    """
    name, family = term.effect.name, term.effect.family
    effects = [(each, each.candidate.effect) for each in model.probes]
    found = [each for each, law in effects if law.family == family and law.name != name]
    if model.fit.kept is not None:
        others = {s.candidate.label for s in rivals if s.candidate.effect.family != family}
        found += [each for each in model.scores if each.candidate.label in others]
    return [each.candidate for each in found if each.score >= search.threshold]


def _fitted_in_place(search: Search, fit: Fit, term: Term, candidate: Candidate) -> Fit:
    """A fit with a candidate in place of a term, fitted as long as it may become better."""
    return search.refitted(fit, _exchanged(search, fit, term, candidate), search.criterion(fit))


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


def _at_one_part(search: Search, fit: Fit) -> Fit | None:
    """A fit with its form at the largest part alone, fitted again; None if others have much of it."""
    *others, term = fit.terms
    alone, share = at_largest_part(term)
    if share < ALONE:
        return None
    return search.refitted(fit, (*others, alone), search.criterion(fit))


def promised_per_part(
    search: Search, model: ScoredModel, others: Terms, even: Term
) -> Promise | None:
    """Promise of a model with a size of a term for each part beside others; None if it has no parts."""
    fitter = search.fitter
    term = per_part_term(even, fitter.windows.robot, SPREAD)
    if term is None:
        return None
    begun = replace(fitter.with_terms(model.fit, (*others, term)), cache=model.fit.cache)
    return promised(fitter, model, begun)


def _per_part(search: Search, model: ScoredModel, family: str) -> Fit | None:
    """The model with a size of an effect for each part, fitted; None if that promises too little.

    Numbers of a robot as built differ between parts, too: it must promise about as much as they do.
    """
    fit, fitter = model.fit, search.fitter
    term = _of_family(fit, family)
    others = without(fit.terms, term)
    promise = promised_per_part(search, model, others, term)
    if promise is None or (promise.explained < search.threshold and term.place is None):
        return None
    if search.promised_as_built(model, search.settings.more * promise.explained) is not None:
        return None
    *_, uneven = promise.fit.terms
    search.heartbeat(f"fitting {term.effect.name} {uneven.effect.form}")
    sized = _sized_by_part(fitter, model, term, uneven)
    starts = (promise.fit, fitter.with_terms(fit, (*others, sized)))
    begun = replace(min(starts, key=lambda each: each.cost), cache=fit.cache)
    return search.fit_until(begun, search.criterion(fit))


def _sized_by_part(fitter: Fitter, model: ScoredModel, term: Term, uneven: Term) -> Term:
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
    return with_shares(uneven, size * (present + more), SPREAD)


def _rival_per_part(search: Search, fit: Fit, score: Score) -> Fit | None:
    """A fit with another effect in place of its form, fitted; None if that has other parts.

    It starts with the same factors: a cable with more friction has more of it by any law.
    """
    fitter, effect, term = search.fitter, score.candidate.effect, fit.terms[-1]
    robot = fitter.windows.robot
    if effect.family == term.effect.family or not acts_on_same_parts(effect, term, robot):
        return None
    *rest, even = _exchanged(search, fit, term, score.candidate)
    terms, most = (*rest, alike(even, term, robot)), fitter.settings.stopping.rounds
    return search.refitted(fit, terms, search.criterion(fit), most)
