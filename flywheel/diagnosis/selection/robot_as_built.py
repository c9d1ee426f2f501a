"""What all numbers of a robot, each a little off, promise to explain beside a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.score_test import Projection, ScoredModel
from flywheel.diagnosis.selection.search import Search


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
    """What the numbers promise; None where they are not asked about, or in the model, or nothing is left."""
    fitter, fit = search.fitter, model.fit
    if not search.as_built or fit.kept is not None or model.beyond_noise < search.threshold:
        return None
    begun = fitter.with_terms(fit, (*fit.terms, *search.as_built))
    begun = fitter.keeping(begun, search.as_built)
    free = [f for f in fitter.free(begun.terms) if f.term >= len(fit.terms)]
    own = Projection.of(
        fitter,
        model.jacobian,
        fitter.by_value(begun, free),
        np.ones(len(fit.local)),
        np.array([f.prior for f in free]),
    )
    whole, left = own.unknown(fit.residual[..., None]), own(fit.residual[..., None])
    return AsBuiltPromise(begun, float((whole**2).sum() - (left**2).sum()) - own.price)
