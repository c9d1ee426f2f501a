"""Numbers of the MJCF that may be wrong where an effect seems to be missing; they are never an answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from flywheel.diagnosis.fitting.nuisance import asked
from flywheel.diagnosis.selection.alternatives import RIVAL
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.score_test import Score, sensitivities, slices_of
from flywheel.diagnosis.selection.step import Step
from flywheel.diagnosis.selection.stepwise import Selection
from flywheel.effects import CALIBRATIONS

LIKELY = 0.25  # share that a number is off at most


@dataclass(frozen=True)
class Doubtful:
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
        """As in JSON."""
        return {
            "name": self.name,
            "off": self.off,
            "score": self.score,
            "instead_of": self.instead or None,
        }


def doubtful_numbers(
    selection: Selection, steps: Sequence[Step], unexplained: bool
) -> tuple[Doubtful, ...]:
    """Numbers that nobody said to be unsure of, the one that scores highest first.

    Args:
      selection, steps: that led to the answer.
      unexplained: the answer leaves something, which a number beside it may explain.
    """
    found: dict[str, Doubtful] = {}
    for step, after in zip(steps, [*steps[1:], None], strict=True):
        if after is None and not unexplained:
            break
        explained = max(score.power for score in step.scores)
        if after is not None:  # which may be more than its score promised
            explained = max(explained, step.fit.cost - after.fit.cost)
        for score in _scores(selection, step):
            name, off = score.candidate.effect.name, score.sizes[0] * score.candidate.typical[0]
            seen = score.score >= selection.threshold and score.power >= RIVAL * explained
            if seen and abs(off) <= LIKELY and name not in found:
                instead = "" if after is None else _added(selection, step, after)
                more = score.power > explained
                found[name] = Doubtful(name, float(off), score.score, instead, more)
    return tuple(sorted(found.values(), key=lambda each: -each.score))


def _added(selection: Selection, step: Step, after: Step) -> str:
    """What a step has more than the one before, or else what it has."""
    robot = selection.fitter.windows.robot
    terms = selection.new([step, after]) or asked(after.fit.terms)
    return " with ".join(term.label(robot) for term in terms)


def _scores(selection: Selection, step: Step) -> list[Score]:
    """Of all numbers that the model does not have, and that are not asked about anyway."""
    fitter, had = selection.fitter, {term.effect.name for term in step.fit.terms}
    had |= {candidate.effect.name for candidate in selection.library}
    library = {name: each for name, each in CALIBRATIONS.items() if name not in had}
    numbers, test = candidates(fitter.windows.robot, library), step.test
    if not numbers:
        return []
    fit = fitter.under(step.fit, step.fit.terms)  # in the time steps that the fitter has by now
    columns, shorter = sensitivities(fitter, fit, numbers, test.projection, test.residual)
    of_numbers = replace(
        test, candidates=numbers, columns=columns, shorter=shorter, slices=slices_of(numbers)
    )
    return of_numbers.scores()
