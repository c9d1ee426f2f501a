"""Two effects scored together: what explains nothing alone may do so beside another."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from flywheel.diagnosis.selection.score_test import Score, ScoreTest
from flywheel.effects import Terms
from flywheel.records import Floats

PAIRS = 1  # that are worth a refit
MORE = 1.2  # times what the best explains alone, from which a pair is tried
AMONG = 25  # candidates, the best ones
SINGULAR = 1e6  # condition of two effects that cannot be told apart


def promising_pairs(test: ScoreTest, scores: Sequence[Score], threshold: float) -> list[Terms]:
    """Pairs that promise to explain clearly more than the best candidate alone, the best first.

    Args:
      scores: of the test's candidates, best first.
      threshold: score from which an effect counts as seen, which the second one has to add.
    """
    gram, pull = test.columns.T @ test.columns, test.columns.T @ test.residual
    index = {score.candidate: i for i, score in enumerate(test.scores())}
    found = []
    for pair in combinations(scores[:AMONG], 2):
        columns = [
            np.arange(test.columns.shape[1])[test.slices[index[s.candidate]][s.shape]] for s in pair
        ]
        both = np.concatenate(columns)
        a, b = gram[np.ix_(both, both)], pull[both]
        if np.linalg.cond(a) > SINGULAR:
            continue
        sizes = np.linalg.solve(a, b)
        parts = np.split(sizes, [len(columns[0])])
        if not all(_allowed(s, part) for s, part in zip(pair, parts, strict=True)):
            continue
        terms = tuple(
            s.candidate.term(tuple(part), s.shape) for s, part in zip(pair, parts, strict=True)
        )
        found.append((float(b @ sizes), terms))
    found.sort(key=lambda each: -each[0])
    least = MORE * scores[0].power + threshold
    return [terms for power, terms in found[:PAIRS] if power > least]


def _allowed(score: Score, sizes: Floats) -> bool:
    """Sizes that cannot be negative are not."""
    parameters = score.candidate.effect.sizes
    return all(s >= 0 or not p.one_sided for s, p in zip(sizes, parameters, strict=True))
