"""The terms that a search fits next: those that promise the most on top of its model.

Two candidates are scored together, too: one that explains nothing alone may do so in addition to another.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import combinations

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.nuisance import as_said
from flywheel.diagnosis.selection.candidates import Candidate, at_parts, places
from flywheel.diagnosis.selection.scores import (
    Score,
    ScoredModel,
    ScoreTest,
    further_scores,
    solved,
)
from flywheel.diagnosis.selection.search import Search
from flywheel.effects import Term, Terms

SIZES = (-2.0, -1.0, 1.0, 2.0)  # tried at the first estimates, in typical sizes
PAIRS = 25  # best candidates that are scored two at a time
SINGULAR = 1e6  # condition number of two effects that cannot be distinguished


def proposals(search: Search, model: ScoredModel, room: int) -> list[Terms]:
    """Terms to be fitted on top of a model, those of the best candidate first; none if none is visible.

    They are those of the short list, and beside it whatever promises clearly more than the best of it:
    another law, an effect at one part alone, and two candidates together if there is `room`. If that is
    little of what is left, it may be an effect that explains most of the error at the first estimates.
    """
    if model.scores[0].score < search.threshold:
        return []
    spared = search.heartbeat.spared
    one = search.shortlist(model)
    further = partial(screened, search, model, tuple(one))
    one += spared(partial(promising_forms, search, model), list[Score](), "effects at one part")
    found: list[Terms] = [(each.term,) for each in one]
    found += spared(further, list[Terms](), "effects at the first estimates")
    if room > 1:
        two = partial(promising_pairs, model.test, model.scores[:PAIRS], search.settings.more)
        found += spared(two, list[Terms](), "pairs of effects")
    return found


def promising_forms(search: Search, model: ScoredModel) -> list[Score]:
    """Other laws, and effects at one cable or winch alone, that promise clearly more than any candidate.

    Effects at one part alone, which need simulations, are only tested if so much is left.
    """
    settings, asked = search.settings, {each.effect.family for each in search.library}
    least = settings.more * model.scores[0].statistic
    forms = [each for each in model.probes if each.candidate.effect.form]
    found = [each for each in forms if each.candidate.effect.family in asked]
    if least < model.beyond_noise:
        alone = at_parts(search.fitter.windows.robot, search.library)
        found += further_scores(search.fitter, model.fit, model.test, alone)
    promising = [each for each in found if each.statistic > least]
    return sorted(promising, key=lambda each: -each.statistic)[: settings.per_family]


def screened(search: Search, model: ScoredModel, known: Sequence[Score]) -> list[Terms]:
    """A further effect that explains most of the model's residual at the first estimates; usually none.

    Initial states fitted under a wrong model compensate for its error. If that is large, and if contacts
    make motions diverge, sensitivities around them may be unrelated to the explanation by an effect, even
    in sign. First estimates come from the measurements alone: noisy, but unbiased.

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
    tried = [term for size in SIZES for term in candidate.unit_terms(size)]  # within bounds
    terms = [each for each in dict.fromkeys(tried) if any(each.values[: len(candidate.typical)])]
    points = fitter.predictions(begun, [(*begun.terms, term) for term in terms])
    costs = np.array([(fitter.windows.residual(each) ** 2).sum() for each in points])
    costs = np.where(np.isfinite(points).all(axis=(1, 2, 3, 4)), costs, np.inf)
    return float(costs.min()), terms[int(costs.argmin())]


def _same_way(score: Score, candidate: Candidate, term: Term) -> bool:
    """A score that proposes this effect at its place, with a size of the same sign."""
    if score.candidate is not candidate:  # which may have another number of sizes
        return False
    return float(np.dot(score.sizes, term.values[: len(score.sizes)])) > 0  # shapes have no sign


def promising_pairs(test: ScoreTest, scores: Sequence[Score], more: float) -> list[Terms]:
    """The pair of some of a test's candidates, best first, that promises to explain the most.

    None if that is not so many times `more` than the best one alone; the second must add a visible amount.
    """
    gram, right = test.columns.T @ test.columns, test.columns.T @ test.residual
    every, best = np.arange(len(right)), more * scores[0].statistic + test.threshold
    found: list[Terms] = []
    for pair in combinations(scores, 2):
        where = [every[test.slice_of(score)] for score in pair]
        both = np.concatenate(where)
        a, b = gram[np.ix_(both, both)], right[both]
        if np.linalg.cond(a) > SINGULAR:
            continue
        sizes, explained = solved(a, b, [p for s in pair for p in s.candidate.effect.sizes])
        if explained > best:
            parts = zip(pair, np.split(sizes, [len(where[0])]), strict=True)
            best, found = explained, [tuple(s.candidate.term(tuple(p), s.shape) for s, p in parts)]
    return found
