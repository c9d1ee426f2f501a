"""What all numbers of a robot, each a little off, promise to explain beside a model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.score_test import Projection, ScoredModel
from flywheel.diagnosis.selection.search import Search
from flywheel.effects import Term


@dataclass(frozen=True)
class AsBuiltPromise:
    """What the numbers promise.

    Attributes:
      begun: the model with them, at what the MJCF says.
      explained: less what they cost, in its linearisation [sigma^2].
    """

    begun: Fit
    explained: float


def promised_as_built(search: Search, model: ScoredModel) -> AsBuiltPromise | None:
    """What the numbers promise; None where they are not asked about, or in the model, or nothing is left.

    How well a robot was made is not known beforehand: of several shares of the deviations the one is taken
    that makes the recordings the most likely (type II maximum likelihood). Numbers that may be farther off
    than they are cost more than they explain, and single effects would be named in their place.
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
    """What numbers of a robot explain of a fit's residual, less what they cost [sigma^2]."""
    before, left = numbers.unknown(fit.residual[..., None]), numbers(fit.residual[..., None])
    return float((before**2).sum() - (left**2).sum()) - numbers.price


def known_share(search: Search, fit: Fit) -> float:
    """The share of the usual deviations that a fit has its numbers of a robot as built within."""
    usual = search.as_built[0]
    taken = next(
        t for t in fit.terms if (t.effect.name, t.place) == (usual.effect.name, usual.place)
    )
    return taken.known[0] / usual.known[0]


def _known_to(term: Term, share: float) -> Term:
    """A term whose values are known to a share of their deviations."""
    return replace(term, known=tuple(share * known for known in term.known))
