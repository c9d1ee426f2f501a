"""Effects as seen from the first estimates of all starts, where a wrong model has led fitted ones astray.

Starts that are fitted under a wrong model make up for what it lacks. Where that is much, and where
contacts make motions turn, what an effect changes around such starts may say nothing of what it would
explain, not even its sign. First estimates come from the measurements alone: noisy, but not misled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.nuisance import as_said
from flywheel.diagnosis.fitting.plant_fit import StartFitter
from flywheel.diagnosis.fitting.stopping import worth_a_round
from flywheel.diagnosis.selection.candidates import Candidate
from flywheel.diagnosis.selection.deduplication import places
from flywheel.diagnosis.selection.score_test import Score
from flywheel.diagnosis.selection.step import Step
from flywheel.effects import Term, Terms

SIZES = (-2.0, -1.0, 1.0, 2.0)  # that are tried, in multiples of the typical one
# Of what a fit leaves, that some score must promise to be believed; of what first estimates leave, that an
# effect must explain there.
BELIEVED, MOSTLY = 0.5, 0.5


def at_first_sight(
    fitter: Fitter, step: Step, library: Sequence[Candidate], known: Sequence[Score]
) -> list[Terms]:
    """A further effect that explains most of what the model leaves at the first estimates; none mostly.

    It is only asked where a model is clearly wrong, and no score promises to explain much of it; and not of
    a network, which begins with what it saw.

    Args:
      fitter, step: the model.
      library: what may be added.
      known: what is refitted anyway.
    """
    believed = max(score.power for score in step.scores) > BELIEVED * step.left
    wrong = isinstance(fitter, StartFitter) and worth_a_round(fitter, step.fit) > 0.0
    had = places(step.fit.terms)
    further = [each for each in library if (each.effect.name, each.place) not in had]
    if believed or not wrong or not further:
        return []
    begun = fitter.beginning(as_said(step.fit.terms))  # what was fitted was misled, too
    best = [(*_best(fitter, begun, candidate), candidate) for candidate in further]
    cost, term, candidate = min(best, key=lambda each: each[0])
    explained = begun.cost - cost > MOSTLY * (begun.cost - step.test.freedom)
    if not explained or any(_same_way(score, candidate, term) for score in known):
        return []
    return [(term,)]


def _best(fitter: Fitter, begun: Fit, candidate: Candidate) -> tuple[float, Term]:
    """What the windows' residuals cost with the best of its terms, without any fit."""
    terms = list(dict.fromkeys(_terms(candidate)))  # bounded sizes are the same ones
    points = fitter.predictions(begun, [(*begun.terms, term) for term in terms])
    costs = np.array([(fitter.windows.residual(each) ** 2).sum() for each in points])
    costs = np.where(np.isfinite(points).all(axis=(1, 2, 3, 4)), costs, np.inf)
    return float(costs.min()), terms[int(costs.argmin())]


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
