"""The criterion by which models are compared: a Bayesian information criterion (BIC) with priors.

Twice the negative logarithm of the marginal likelihood of a model, in Laplace's approximation and up to a
constant, is

    cost + k log n + log det(I + P S P)

with k values without a prior, n noisy measurements, and the standard deviations P and the information S of
the values with a prior, after all others. The cost includes the squares of these values relative to
P. The determinant is their price; it is computed when they are proposed, and stays with their terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.projection import Projection
from flywheel.diagnosis.selection.scores import Linearised


@dataclass(frozen=True)
class Promise:
    """Promise of terms with a prior on top of a model.

    Attributes:
      fit: of the model with them, before anything is fitted; they have their price.
      explained: decrease of the criterion in the linearisation of the model [sigma^2].
    """

    fit: Fit
    explained: float


def promised(
    fitter: Fitter, model: Linearised, begun: Fit, shares: Sequence[float] = (1.0,)
) -> Promise:
    """Promise of the terms that a fit `begun` from a model has, and the model has not.

    Of the `shares`, factors on the standard deviations of their priors, the most likely one is used
    (type II maximum likelihood).
    """
    new = [term not in model.fit.terms for term in begun.terms]
    free = sorted(fitter.free(begun.terms), key=lambda f: new[f.term])
    had = sum(not new[f.term] for f in free)
    columns, prior = fitter.by_value(begun, free), np.array([f.prior for f in free])
    residual = model.fit.residual[..., None]
    less, more = (
        Projection.of(fitter, model.jacobian, columns[..., :count], None, prior[:count])
        for count in (had, len(free))
    )

    def left(projection: Projection) -> float:
        return float((projection(residual) ** 2).sum()) + projection.price

    share = min(shares, key=lambda each: left(more.with_priors_scaled(each)))
    scaled = more.with_priors_scaled(share)
    price, terms = (scaled.price - less.price) / sum(new), list(begun.terms)
    for at in np.flatnonzero(new):
        known = tuple(share * deviation for deviation in terms[at].known)
        terms[at] = replace(terms[at], known=known, price=price)
    return Promise(replace(begun, terms=tuple(terms)), left(less) - left(scaled))
