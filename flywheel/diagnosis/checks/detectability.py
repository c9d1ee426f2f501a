"""Smallest detectable sizes of an effect with slightly different initial states.

A score test promises detection of an effect of some size from sensitivities around fitted initial
states. Those are uncertain, and if contacts make the motion nonlinear, sensitivities around other,
equally good ones differ: only their common part counts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fitter
from flywheel.diagnosis.fitting.projection import DEAD
from flywheel.diagnosis.selection.scores import PART, Score, ScoredModel, secants, slices_of
from flywheel.records import Floats

LEAST = 1e-4  # share that counts as none
# Standard deviations by which initial states are moved; a whole one leaves the valley of the cost.
SHIFT = 0.5


def detectable(fitter: Fitter, model: ScoredModel, rng: np.random.Generator) -> tuple[Score, ...]:
    """The scores of a model, with the smallest sizes that are visible around other initial states, too."""
    test, fit = model.test, model.fit
    local = fit.local + SHIFT * _deviation(fitter, model, rng)
    there = fitter.with_local(fit, local)
    own = [test.slice_of(score) for score in model.scores]
    shorter = np.array([test.shorter[columns].all() for columns in own])
    smallest = np.array([score.smallest for score in model.scores])
    for part, chosen in ((1.0, np.flatnonzero(~shorter)), (PART, np.flatnonzero(shorter))):
        scores = [model.scores[i] for i in chosen]
        shaped = [replace(s.candidate, shapes=(s.candidate.shapes[s.shape],)) for s in scores]
        columns = test.projection(secants(fitter, there, shaped, part))
        for i, (other,) in zip(chosen, slices_of(shaped), strict=True):
            share = common_share(test.columns[:, own[i]], columns[:, other])
            smallest[i] /= np.sqrt(share)
    return tuple(
        replace(score, smallest=float(size))
        for score, size in zip(model.scores, smallest, strict=True)
    )


def _deviation(fitter: Fitter, model: ScoredModel, rng: np.random.Generator) -> Floats:
    """(K, X) local parameters, drawn from the uncertainty due to measurements and priors."""
    local, by_local = model.fit.local, model.jacobian.by_local
    information, _ = fitter.normal_equations(local, by_local, model.fit.residual, 0.0)
    root = np.linalg.cholesky(information).swapaxes(1, 2)
    return np.asarray(np.linalg.solve(root, rng.standard_normal((*local.shape, 1)))[..., 0])


def common_share(here: Floats, there: Floats) -> float:
    """Fraction of the expected signal power (of sensitivities (N, d)) that is detected if the
    effect acts through other sensitivities (N, d).

    At most 1, though others may promise more; above 0, to allow division.
    """
    own, across = here.T @ here, here.T @ there
    seen = np.trace(across.T @ np.linalg.pinv(own) @ across)
    return float(np.clip(seen / max(np.trace(own), DEAD**2), LEAST, 1.0))
