"""Screening of candidates at the first estimates of all initial states.

Initial states fitted under a wrong model compensate for its error. If that is large, and if
contacts make motions diverge, sensitivities around them may be unrelated to the explanation by an
effect, even in sign. First estimates come from the measurements alone: noisy, but unbiased.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.nuisance import as_said
from flywheel.diagnosis.selection.candidates import Candidate, places
from flywheel.diagnosis.selection.score_test import Score, ScoredModel
from flywheel.diagnosis.selection.search import Search
from flywheel.effects import Term, Terms

SIZES = (-2.0, -1.0, 1.0, 2.0)  # that are tried, in typical sizes


def screened(search: Search, model: ScoredModel, known: Sequence[Score]) -> list[Terms]:
    """A further effect that explains most of the model's residual at the first estimates; usually none.

    It is only tested if a model is clearly wrong, and no score promises to explain much of it; and
    not if a model starts from the measurements. Smooth ground needs it: of logs of 2 s one in eight misled
    the fitted states so far that its score had the wrong sign. What is `known` is fitted anyway.
    """
    fitter, share = search.fitter, search.settings.share
    promised = max(score.statistic for score in model.scores) > share * model.left
    wrong = fitter.starts_are_free and fitter.worthwhile(model.fit) > 0.0
    had = places(model.fit.terms)
    further = [each for each in search.library if (each.effect.name, each.place) not in had]
    if promised or not wrong or not further:
        return []
    begun = fitter.first_estimate(as_said(model.fit.terms))  # what was fitted was misled, too
    best = [(*_best(fitter, begun, each), each) for each in further]
    cost, term, candidate = min(best, key=lambda each: each[0])
    explained = begun.cost - cost > share * (begun.cost - model.test.freedom)
    if not explained or any(_same_way(score, candidate, term) for score in known):
        return []
    return [(term,)]


def _best(fitter: Fitter, begun: Fit, candidate: Candidate) -> tuple[float, Term]:
    """Cost of the windows' residuals with the best of its terms, without any fit."""
    terms = list(dict.fromkeys(_terms(candidate)))  # bounded sizes are the same ones
    points = fitter.predictions(begun, [(*begun.terms, term) for term in terms])
    costs = np.array([(fitter.windows.residual(each) ** 2).sum() for each in points])
    costs = np.where(np.isfinite(points).all(axis=(1, 2, 3, 4)), costs, np.inf)
    return float(costs.min()), terms[int(costs.argmin())]


def _terms(candidate: Candidate) -> list[Term]:
    """Each size alone, with each shape, as far as possible."""
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
