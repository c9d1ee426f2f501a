"""Effects as seen from the first estimates of all starts, where a wrong model has led fitted ones astray.

Starts that are fitted under a wrong model make up for what it lacks. Where that is much, and where
contacts make motions turn, what an effect changes around such starts may say nothing of what it would
explain, not even its sign. First estimates come from the measurements alone: noisy, but not misled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.diagnosis.candidates import Candidate
from flywheel.diagnosis.fit import Fitter
from flywheel.diagnosis.score import Score
from flywheel.diagnosis.step import Step
from flywheel.diagnosis.worth import worth_a_round
from flywheel.effects import Term, Terms

SIZES = (-2.0, -1.0, 1.0, 2.0)  # that are tried, in multiples of the typical one
# Of what a fit leaves, that some score must promise to be believed; of what first estimates leave, that an
# effect must explain there.
BELIEVED, MOSTLY = 0.5, 0.5


def at_first_sight(
    fitter: Fitter, step: Step, library: Sequence[Candidate], known: Sequence[Score]
) -> list[Terms]:
    """A further effect that explains most of what the model leaves at the first estimates; none mostly.

    It is only asked where a model is clearly wrong, and no score promises to explain much of it.

    Args:
      fitter, step: the model.
      library: what may be added.
      known: what is refitted anyway.
    """
    believed = max(score.power for score in step.scores) > BELIEVED * step.left
    if believed or not worth_a_round(fitter, step.fit):
        return []
    begun = fitter.beginning(step.fit.terms)
    tried = [(candidate, term) for candidate in library for term in _terms(candidate)]
    points = fitter.predictions(begun, [(*begun.terms, term) for _, term in tried])
    costs = np.array([(fitter.windows.residual(each) ** 2).sum() for each in points])
    costs = np.where(np.isfinite(points).all(axis=(1, 2, 3, 4)), costs, np.inf)
    candidate, term = tried[int(costs.argmin())]
    explained = begun.cost - costs.min() > MOSTLY * (begun.cost - step.test.freedom)
    if not explained or any(_same_way(score, candidate, term) for score in known):
        return []
    return [(term,)]


def _terms(candidate: Candidate) -> list[Term]:
    """Each size alone, with each shape, as far as it can have it."""
    two_sided = np.tile(
        [not size.one_sided for size in candidate.effect.sizes], len(candidate.shapes)
    )
    return [
        term
        for size in SIZES
        for term, both in zip(candidate.unit_terms(size), two_sided, strict=True)
        if both or size > 0
    ]


def _same_way(score: Score, candidate: Candidate, term: Term) -> bool:
    """A score that proposes this effect at its place, with a size of the same sign."""
    if score.candidate is not candidate:  # which may have another number of sizes
        return False
    return float(np.dot(score.sizes, term.values[: len(score.sizes)])) > 0  # shapes have no sign
