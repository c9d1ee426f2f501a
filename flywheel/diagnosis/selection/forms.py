"""Other forms of an effect that was found, before a second one is looked for.

Friction that differs from cable to cable leaves much beside friction that is the same everywhere, and so does
friction in proportion to stiffness. A search that looks on would name a second effect for it. So where an
effect leaves more than noise, it is fitted by other laws of its family, and with a size for each part; what
explains clearly more, for what it costs, is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.selection.candidates import Candidate, at_parts
from flywheel.diagnosis.selection.score_test import Projection, Score, ScoredModel, further_scores
from flywheel.diagnosis.selection.search import Search
from flywheel.effects import PerPart, Term, Terms, alike, at_largest_part, per_part_term


@dataclass(frozen=True)
class _Form:
    """A model with another form of an effect.

    Attributes:
      fit: of it.
      price: of its factors, to be added to its criterion; 0 without any.
    """

    fit: Fit
    price: float = 0.0


def proposed_forms(search: Search, model: ScoredModel) -> list[Term]:
    """Other laws, and effects at one cable or winch alone, that promise clearly more than any candidate.

    They are not asked about where the best candidate promises to explain nearly all that is left.
    """
    settings, best = search.settings.forms, model.scores[0]
    if best.statistic > settings.enough * model.beyond_noise:
        return []
    alone = at_parts(search.fitter.windows.robot, search.library)
    further = further_scores(search.fitter, model.fit, model.test, alone, search.settings.score)
    laws = [each for each in model.probes if each.candidate.effect.form]
    promising = [s for s in (*laws, *further) if s.statistic > settings.more * best.statistic]
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
      rivals: further effects that may have been the one; they may be it if sizes differ from part to part.
    """
    had = {(term.effect.name, term.place) for term in before.fit.terms}
    for term in model.fit.terms:
        if term.asked and (term.effect.name, term.place) not in had:
            model = _in_best_form(search, model, term, rivals)
    return model


def _in_best_form(
    search: Search, model: ScoredModel, term: Term, rivals: Sequence[Score]
) -> ScoredModel:
    fit = model.fit
    if max(each.score for each in (*model.scores, *model.probes)) < search.threshold:
        return model  # nothing is seen beside it
    forms = [_Form(each) for each in _by_other_laws(search, model, term)]
    best = min((_Form(fit), *forms), key=lambda form: search.criterion(form.fit))
    if best.fit is not fit and search.criterion(fit) - search.criterion(best.fit) > 0.0:
        model = search.score_all(best.fit)
        term = next(t for t in model.fit.terms if t.effect.family == term.effect.family)
    uneven = _per_part(search, model, term)
    if uneven is None:
        return model
    others = (_rival_per_part(search, each, uneven) for each in rivals)
    forms = [uneven, *(each for each in others if each is not None)]
    forms += [each for form in forms if (each := _at_one_part(search, form)) is not None]
    best = min(forms, key=lambda form: search.criterion(form.fit) + form.price)
    gained = search.criterion(model.fit) - search.criterion(best.fit) - best.price
    return search.score_all(best.fit) if gained > search.threshold else model


def _by_other_laws(search: Search, model: ScoredModel, term: Term) -> list[Fit]:
    """The model with each other law of the family that explains something beside it, fitted."""
    fit, found = model.fit, []
    target = search.criterion(fit)
    for score in model.probes:
        effect = score.candidate.effect
        other = effect.family == term.effect.family and effect.name != term.effect.name
        if other and score.score >= search.threshold and not isinstance(term.effect, PerPart):
            search.progress(f"fitting {effect.name}")
            begun = search.fitter.with_terms(fit, _exchanged(search, fit, term, score.candidate))
            found.append(search.fit_until(begun, target))
    return found


def _exchanged(search: Search, fit: Fit, term: Term, candidate: Candidate) -> Terms:
    """Terms of a fit with a candidate in the place of one of them, of the size that changes as much."""
    fitter = search.fitter
    rest = tuple(each for each in fit.terms if each is not term)
    bare = fitter.with_terms(fit, rest)
    units = candidate.unit_terms()
    columns = fitter.columns(bare, [(*rest, each) for each in (term, *units)])
    wanted, own = columns[..., 0].ravel(), columns[..., 1:].reshape(-1, len(units))
    size = own.T @ wanted / np.maximum((own**2).sum(axis=0), 1e-12)
    alike = size * (own.T @ wanted)  # fall of the squares of what the term changes
    best = int(np.argmax(alike))
    return (*rest, candidate.term((float(size[best]),), best))


def _at_one_part(search: Search, found: _Form) -> _Form | None:
    """The model with the effect at its largest part alone, fitted; None where others have much of it."""
    fit = found.fit
    term = next(t for t in fit.terms if isinstance(t.effect, PerPart))
    alone, share = at_largest_part(term)
    if share < search.settings.forms.alone:
        return None
    search.progress(f"fitting {term.effect.name} at one {term.effect.part}")
    terms = tuple(alone if each is term else each for each in fit.terms)
    begun = search.fitter.with_terms(fit, terms)
    return _Form(search.fit_until(begun, search.criterion(fit) + found.price))


def promised_per_part(search: Search, model: ScoredModel, score: Score) -> float:
    """What a candidate with a size for each part promises to explain, less its price [sigma^2]."""
    even = score.candidate.term(score.sizes, score.shape)
    term = per_part_term(even, search.fitter.windows.robot, search.settings.forms.spread)
    if term is None:
        return 0.0
    explained, price = _explained(search.fitter, model, (*model.fit.terms, term), term)
    return explained - price


def _per_part(search: Search, model: ScoredModel, term: Term) -> _Form | None:
    """The model with a size of the term for each part, fitted; None if that promises too little."""
    fit, fitter = model.fit, search.fitter
    uneven = per_part_term(term, fitter.windows.robot, search.settings.forms.spread)
    if uneven is None:
        return None
    terms = tuple(uneven if each is term else each for each in fit.terms)
    explained, price = _explained(fitter, model, terms, uneven)
    if explained - price < search.threshold:
        return None
    search.progress(f"fitting {term.effect.name} {uneven.effect.form}")
    begun = replace(fitter.with_terms(fit, terms), cache=fit.cache)
    return _Form(search.fit_until(begun, search.criterion(fit) - price), price)


def _explained(fitter: Fitter, model: ScoredModel, terms: Terms, term: Term) -> tuple[float, float]:
    """What a term would explain beside the values that a model has, in its linearisation, and its price."""
    fit = model.fit
    begun = replace(fitter.with_terms(fit, terms), cache=fit.cache)
    free = sorted(fitter.free(terms), key=lambda f: terms[f.term] is term)
    columns = fitter.by_value(begun, free)
    prior, ones = np.array([f.prior for f in free]), np.ones(len(fit.local))
    had = len(free) - len(term.values)
    less, more = (
        Projection.of(fitter, model.jacobian, columns[..., :count], ones, prior[:count])
        for count in (had, len(free))
    )
    left = [float((each(fit.residual[..., None]) ** 2).sum()) for each in (less, more)]
    return left[0] - left[1], max(0.0, more.price - less.price)


def _rival_per_part(search: Search, score: Score, found: _Form) -> _Form | None:
    """The model with another effect in its place, fitted; None where that has not the same parts.

    It begins with the same factors: where a cable rubs more, it does so by any law.
    """
    fit, fitter = found.fit, search.fitter
    term = next(t for t in fit.terms if isinstance(t.effect, PerPart))
    if score.candidate.effect.family == term.effect.family:
        return None
    *rest, even = _exchanged(search, fit, term, score.candidate)
    other = alike(even, term, fitter.windows.robot)
    if other is even:
        return None
    search.progress(f"fitting {other.effect.name} {other.effect.form}")
    begun = fitter.with_terms(fit, (*rest, other))
    most = search.settings.max_rounds_to_target_of_law
    return _Form(search.fit_until(begun, search.criterion(fit), most), found.price)
