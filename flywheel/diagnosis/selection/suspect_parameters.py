"""Numbers of the MJCF that may be wrong where an effect seems to be missing; they are never an answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from flywheel.diagnosis.fitting.nuisance import asked
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.score_test import Score, ScoredModel, sensitivities, slices_of
from flywheel.diagnosis.selection.search import Search, added
from flywheel.effects import CALIBRATIONS


@dataclass(frozen=True)
class SuspectParameter:
    """A number of the MJCF which, if it were another, would explain nearly as much as an effect.

    Attributes:
      name: of the number.
      off: by how much it would have to be more, as a share.
      score: like a candidate's.
      instead: what was added where it was asked for; "" where it explains something beside the answer.
      more: it promises more than that explained.
    """

    name: str
    off: float
    score: float
    instead: str
    more: bool

    def summary(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "name": self.name,
            "off": self.off,
            "score": self.score,
            "instead_of": self.instead or None,
        }


def suspect_parameters(
    search: Search, models: Sequence[ScoredModel], unexplained: bool
) -> tuple[SuspectParameter, ...]:
    """Numbers that nobody said to be unsure of, the one that scores highest first.

    Args:
      search, models: that led to the answer.
      unexplained: the answer leaves something, which a number beside it may explain.
    """
    found: dict[str, SuspectParameter] = {}
    for model, after in zip(models, [*models[1:], None], strict=True):
        if after is None and not unexplained:
            break
        explained = max(score.statistic for score in model.scores)
        if after is not None:  # which may be more than its score promised
            explained = max(explained, model.fit.cost - after.fit.cost)
        for score in _scores(search, model):
            name, off = score.candidate.effect.name, score.sizes[0] * score.candidate.typical[0]
            seen = (
                score.score >= search.threshold
                and score.statistic >= search.settings.rival * explained
            )
            if seen and abs(off) <= search.settings.suspect_share and name not in found:
                instead = "" if after is None else _added(search, model, after)
                more = score.statistic > explained
                found[name] = SuspectParameter(name, float(off), score.score, instead, more)
    return tuple(sorted(found.values(), key=lambda each: -each.score))


def _added(search: Search, model: ScoredModel, after: ScoredModel) -> str:
    """What a model has more than the one before, or else what it has."""
    robot = search.fitter.windows.robot
    terms = added([model, after]) or asked(after.fit.terms)
    return " with ".join(term.label(robot) for term in terms)


def _scores(search: Search, model: ScoredModel) -> list[Score]:
    """Scores of all numbers that the model does not have, and that are not asked about anyway."""
    fitter, had = search.fitter, {term.effect.name for term in model.fit.terms}
    had |= {candidate.effect.name for candidate in search.library}
    library = {
        name: each
        for name, each in CALIBRATIONS.items()
        if name not in had and each.where == "robot"
    }
    numbers, test = candidates(fitter.windows.robot, library), model.test
    if not numbers:
        return []
    fit = fitter.with_terms(
        model.fit, model.fit.terms
    )  # in the time steps that the fitter has by now
    columns, shorter = sensitivities(
        fitter, fit, numbers, test.projection, test.residual, search.settings.score
    )
    of_numbers = replace(
        test, candidates=numbers, columns=columns, shorter=shorter, slices=slices_of(numbers)
    )
    return of_numbers.scores()
