"""Promise of all numbers of a robot, each slightly off, on top of a model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.score_test import Projection, ScoredModel
from flywheel.diagnosis.selection.search import Search
from flywheel.effects import Term


@dataclass(frozen=True)
class AsBuiltPromise:
    """Promise of the numbers.

    Attributes:
      begun: the model with them, at the MJCF's values.
      explained: minus their price, in its linearisation [sigma^2].
    """

    begun: Fit
    explained: float


def promised_as_built(search: Search, model: ScoredModel) -> AsBuiltPromise | None:
    """Promise of the numbers; None if they are no candidates, or in the model, or nothing is left.

    The tolerances of a robot are not known beforehand: of several fractions of the standard
    deviations the one with the most likely recordings is used (type II maximum likelihood). With
    too wide priors the numbers cost more than they explain, and single effects would be named
    instead.
    """
    fitter, fit = search.fitter, model.fit
    if not search.as_built or fit.kept is not None or model.beyond_noise < search.threshold:
        return None
    begun = fitter.with_terms(fit, (*fit.terms, *search.as_built))
    begun = fitter.keeping(begun, search.as_built)
    free = [f for f in fitter.free(begun.terms) if f.term >= len(fit.terms)]
    whole = Projection.of(
        fitter,
        model.jacobian,
        fitter.by_value(begun, free),
        np.ones(len(fit.local)),
        np.array([f.prior for f in free]),
    )
    by_share = {
        share: _explained(whole.with_priors_scaled(share), fit)
        for share in search.settings.as_built_shares
    }
    best = max(by_share, key=by_share.__getitem__)
    terms = tuple(_known_to(t, best) if t in search.as_built else t for t in begun.terms)
    return AsBuiltPromise(replace(begun, terms=terms), by_share[best])


def _explained(numbers: Projection, fit: Fit) -> float:
    """Explanation of a fit's residual by numbers of a robot, minus their price [sigma^2]."""
    before, left = numbers.unknown(fit.residual[..., None]), numbers(fit.residual[..., None])
    return float((before**2).sum() - (left**2).sum()) - numbers.price


def known_share(search: Search, fit: Fit) -> float:
    """The fraction of the usual standard deviations in a fit with numbers of a robot as built."""
    usual = search.as_built[0]
    taken = next(
        t for t in fit.terms if (t.effect.name, t.place) == (usual.effect.name, usual.place)
    )
    return taken.known[0] / usual.known[0]


def _known_to(term: Term, share: float) -> Term:
    """A term whose values have a fraction of their prior standard deviations."""
    return replace(term, known=tuple(share * known for known in term.known))
