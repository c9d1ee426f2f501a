"""Which models, places and predictions are the same."""

from __future__ import annotations

import math
from collections.abc import Sequence

from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.score_test import Score
from flywheel.effects import Term, Terms

SAME = 1e-9  # relative difference of the costs of two models that predict the same


def different(fits: Sequence[Fit]) -> list[Fit]:
    """Fits without those that cost the same to the last digit as one before; diverging ones all differ."""
    found: list[Fit] = []
    for fit in fits:
        twins = [math.isclose(fit.cost, each.cost, rel_tol=SAME) for each in found]
        if math.isinf(fit.cost) or not any(twins):
            found.append(fit)
    return found


def same_place(score: Score, term: Term) -> bool:
    """A score of the effect of a term, at its place."""
    candidate = score.candidate
    return candidate.effect.name == term.effect.name and candidate.place == term.place


def places(terms: Terms) -> set[tuple[str, int | None]]:
    """Which effects, and where."""
    return {(term.effect.name, term.place) for term in terms}
