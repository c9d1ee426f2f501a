"""Other forms of an identified effect, before a second one is searched for.

Friction that differs between cables leaves a large residual if it is modelled as equal, and so does
friction in proportion to stiffness. A search would name a second effect for it. If an effect leaves
more than noise, it is therefore fitted by other laws of its family, and with a size for each part;
a form that is clearly better, including its penalty, is used. A fit with a form has it as its last term.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.candidates import Candidate, families
from flywheel.diagnosis.selection.criterion import Promise, promised
from flywheel.diagnosis.selection.scores import ScoredModel, slices_of
from flywheel.diagnosis.selection.search import Search, without
from flywheel.effects import (
    Term,
    Terms,
    at_largest_part,
    per_part_term,
)

# Standard deviation of the logarithm of the ratio between parts: most are within a factor of two.
SPREAD = 0.5
# Smallest share of the largest part in the sum over all, for trying the effect there alone; factors are drawn
# to one, so that those of the others do not vanish.
ALONE = 0.4


def in_other_forms(search: Search, before: ScoredModel, model: ScoredModel) -> ScoredModel:
    """A model whose new effects have the form that explains clearly more than others, if any does."""
    had = {family for family, _ in families(before.fit.terms)}
    new = {family for family, _ in families(model.fit.terms)}
    for family in sorted(new - had):
        model = _by_part(search, _by_other_law(search, model, family), family)
    return model


def _by_other_law(search: Search, model: ScoredModel, family: str) -> ScoredModel:
    """A model with the best law of a family that is visible on top of that family's effect."""
    if not _seen_beside(search, model):
        return model
    term = _of_family(model.fit, family)
    effects = ((score, score.candidate.effect) for score in model.probes)
    own = [score for score, law in effects if law.family == family and law.name != term.effect.name]
    laws = [score.candidate for score in own if score.score >= search.threshold]
    tried = partial(_fitted_in_place, search, model.fit, term)
    fits = search.heartbeat.each(tried, laws, lambda each: f"fitting {each.label}")
    form = min((model.fit, *fits), key=search.criterion)
    return model if form is model.fit else search.score_all(search.settled(form))


def _by_part(search: Search, model: ScoredModel, family: str) -> ScoredModel:
    """A model with a size of an effect for each part, or at one part alone, if that is clearly better."""
    if not _seen_beside(search, model):
        return model
    spared = search.heartbeat.spared
    sized = partial(_per_part, search, model, family)
    uneven = spared(sized, None, f"{family} with a size for each part")
    if uneven is None:
        return model
    alone = spared(partial(_at_one_part, search, uneven), None, f"{family} at one part")
    best = min((uneven, alone or uneven), key=search.criterion)
    gained = search.criterion(model.fit) - search.criterion(best)
    return model if gained <= search.threshold else search.score_all(search.settled(best))


def _seen_beside(search: Search, model: ScoredModel) -> bool:
    """True if an effect is visible on top of a model."""
    return max(each.score for each in (*model.scores, *model.probes)) >= search.threshold


def _of_family(fit: Fit, family: str) -> Term:
    """The effect of a family that a model has."""
    return next(term for term in fit.terms if term.asked and term.effect.family == family)


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
    term = _of_family(model.fit, family)
    promise = promised_per_part(search, model, without(model.fit.terms, term), term)
    if promise is None or (promise.explained < search.threshold and term.place is None):
        return None
    if search.promised_as_built(model, search.settings.more * promise.explained) is not None:
        return None
    *_, uneven = promise.fit.terms
    search.heartbeat(f"fitting {term.effect.name} {uneven.effect.form}")
    return search.fit_until(promise.fit, search.criterion(model.fit))
