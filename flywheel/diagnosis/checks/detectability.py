"""What is still detectable of an effect where windows begin a little elsewhere.

A score test promises that an effect of some size would be seen, by sensitivities around fitted initial
states. Those are known only so well, and where contacts make the motion bend, the sensitivities around
others, which fit about as well, are others: as much as both have in common is kept.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.selection.score_test import DEAD, Score, ScoredModel, ScoreTest, secants
from flywheel.diagnosis.settings import CheckSettings
from flywheel.records import Floats

LEAST = 1e-4  # share that counts as none


def detectable(
    fitter: Fitter,
    model: ScoredModel,
    rng: np.random.Generator,
    settings: CheckSettings = CheckSettings(),
) -> tuple[Score, ...]:
    """The scores of a model, with the smallest sizes that are shown around other initial states, too."""
    test, fit = model.test, model.fit
    local = fit.local + settings.shift * _deviation(fitter, model, rng)
    there = _sensitivities(fitter, fitter.with_local(fit, local), test)
    found = []
    for score in model.scores:
        own = test.slices[test.candidates.index(score.candidate)][score.shape]
        share = common_share(test.columns[:, own], there[:, own])
        found.append(replace(score, smallest=float(score.smallest / np.sqrt(share))))
    return tuple(found)


def _sensitivities(fitter: Fitter, fit: Fit, test: ScoreTest) -> Floats:
    """(N, n) sensitivities like those of a test, around another fit."""
    found = test.projection(secants(fitter, fit, test.candidates))
    for candidate, slices in zip(test.candidates, test.slices, strict=True):
        own = slice(slices[0].start, slices[-1].stop)
        if test.shorter[own].any():
            share = test.projection(secants(fitter, fit, [candidate], test.part))
            found[:, own] = np.where(test.shorter[own], share, found[:, own])
    return found


def _deviation(fitter: Fitter, model: ScoredModel, rng: np.random.Generator) -> Floats:
    """(K, X) local parameters, drawn as far off as measurements and priors leave them."""
    local, by_local = model.fit.local, model.jacobian.by_local
    information, _ = fitter.normal_equations(local, by_local, model.fit.residual, 0.0)
    root = np.linalg.cholesky(information).swapaxes(1, 2)
    return np.asarray(np.linalg.solve(root, rng.standard_normal((*local.shape, 1)))[..., 0])


def common_share(here: Floats, there: Floats) -> float:
    """Share of what sensitivities (N, d) promise, that they show of an effect which acts by others (N, d).

    At most 1, though others may promise more; above 0, so that what is divided by it stays a number.
    """
    own, across = here.T @ here, here.T @ there
    seen = np.trace(across.T @ np.linalg.pinv(own) @ across)
    return float(np.clip(seen / max(np.trace(own), DEAD**2), LEAST, 1.0))
