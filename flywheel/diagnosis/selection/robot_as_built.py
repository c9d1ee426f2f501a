"""Promise of all numbers of a robot, each slightly off, on top of a model."""

from __future__ import annotations

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.criterion import Promise, promised
from flywheel.diagnosis.selection.score_test import ScoredModel
from flywheel.diagnosis.selection.search import Search


def promised_as_built(search: Search, model: ScoredModel) -> Promise | None:
    """Promise of the numbers; None if they are no candidates, or in the model, or nothing is left.

    The tolerances of a robot are not known beforehand: of several fractions of the standard
    deviations the one with the most likely recordings is used. With too wide priors the numbers cost more
    than they explain, and single effects would be named instead.
    """
    fitter, fit = search.fitter, model.fit
    if not search.as_built or fit.kept is not None or model.beyond_noise < search.threshold:
        return None
    begun = fitter.with_terms(fit, (*fit.terms, *search.as_built))
    begun = fitter.keeping(begun, search.as_built)
    return promised(fitter, model, begun, search.settings.as_built_shares)


def known_share(search: Search, fit: Fit) -> float:
    """The fraction of the usual standard deviations in a fit with numbers of a robot as built."""
    usual = search.as_built[0]
    taken = next(
        t for t in fit.terms if (t.effect.name, t.place) == (usual.effect.name, usual.place)
    )
    return taken.known[0] / usual.known[0]
