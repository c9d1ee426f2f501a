"""What a diagnosis says: the verdict and everything it rests on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from flywheel.diagnosis.adequacy import Adequacy
from flywheel.diagnosis.evidence import Evidence
from flywheel.diagnosis.score import Score
from flywheel.diagnosis.whereabouts import Whereabouts
from flywheel.effects import Parameter, Term, place_name
from flywheel.records import Floats
from flywheel.robots import Robot

QUANTILE = 1.96  # of a 95 % interval, in standard deviations


class Verdict(StrEnum):
    """The answer in a word."""

    NOISE_ONLY = "NOISE_ONLY"
    EFFECT = "EFFECT"
    AMBIGUOUS = "AMBIGUOUS"
    PARTIAL = "PARTIAL"
    OUTSIDE_LIBRARY = "OUTSIDE_LIBRARY"
    DATA_INSUFFICIENT = "DATA_INSUFFICIENT"
    NOT_CONVERGED = "NOT_CONVERGED"


EXIT_CODES = {
    Verdict.NOISE_ONLY: 0,
    Verdict.EFFECT: 10,
    Verdict.AMBIGUOUS: 11,
    Verdict.PARTIAL: 12,
    Verdict.OUTSIDE_LIBRARY: 13,
    Verdict.DATA_INSUFFICIENT: 20,
    Verdict.NOT_CONVERGED: 21,
}


@dataclass(frozen=True)
class Value:
    """A fitted number.

    Attributes:
      name, unit: of the parameter.
      value: of the robot.
      low, high: its 95 % interval.
      in_plant: with which the plant at its time step comes nearest to the robot.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    in_plant: float

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "unit": self.unit,
            "in_plant": self.in_plant,
        }


@dataclass(frozen=True)
class Found:
    """An effect with fitted values.

    Attributes:
      effect: its name.
      location: name of the cable or point; "" for the whole robot.
      values: of its parameters.
      term: the same, to be added to a plant.
    """

    effect: str
    location: str
    values: tuple[Value, ...]
    term: Term

    @property
    def shown(self) -> bool:
        """The interval of one of its sizes leaves out zero."""
        sizes = self.values[: len(self.term.effect.sizes)]
        return any(value.low > 0 or value.high < 0 for value in sizes)

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "effect": self.effect,
            "location": self.location,
            "parameters": {v.name: v.summary() for v in self.values},
        }


Alternative = tuple[Found, ...]


@dataclass(frozen=True)
class Errors:
    """Root mean square of measured minus predicted, after the starts were fitted [m].

    Attributes:
      noise: that is in the measurements.
      baseline: of the plant as it was.
      augmented: with the effects that were found.
    """

    noise: float
    baseline: float
    augmented: float

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "noise": self.noise,
            "baseline": self.baseline,
            "augmented": self.augmented,
            "unit": "m",
        }


@dataclass(frozen=True)
class Likeness:
    """How much of what a learned law does an effect of the library would do.

    Attributes:
      effect, location: which.
      share: of the squared change, by its best size; 1 for all of it.
    """

    effect: str
    location: str
    share: float

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {"effect": self.effect, "location": self.location, "share": self.share}


@dataclass(frozen=True)
class StandIn:
    """A law of the cables, learned from the recordings for what the library does not have.

    Attributes:
      errors: on the recordings that it was learned from; the baseline has all effects that were found.
      held_out: on those that it was not, where the baseline is the plant as it was; None without any.
      likeness: effects that do most nearly what it does, the nearest first.
    """

    errors: Errors
    held_out: Errors | None
    likeness: tuple[Likeness, ...]

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "error": self.errors.summary(),
            "held_out": None if self.held_out is None else self.held_out.summary(),
            "like": [each.summary() for each in self.likeness],
        }


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer.

    Attributes:
      verdict: in a word.
      answers: alternatives, the best first; each is a set of effects that act together.
      ranking: of every candidate on top of the plant as it was, best first.
      threshold: score from which an effect counts as seen.
      errors: on the recordings that were fitted.
      held_out: on those that were not; None without any.
      before, after: what the plant as it was leaves, and what the augmented one leaves.
      evidence: to look at.
      seconds: it took.
      model: name of the model under test; "" for the plant itself.
      where: what no effect explains acts; None where nothing is left.
      stand_in: a learned law for it, likewise.
    """

    verdict: Verdict
    answers: tuple[Alternative, ...]
    ranking: tuple[Score, ...]
    threshold: float
    errors: Errors
    held_out: Errors | None
    before: Adequacy
    after: Adequacy
    evidence: Evidence
    seconds: float
    model: str = ""
    where: Whereabouts | None = None
    stand_in: StandIn | None = None

    @property
    def exit_code(self) -> int:
        """Of the command."""
        return EXIT_CODES[self.verdict]

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "verdict": str(self.verdict),
            "model": self.model or "plant",
            "answer_set": [[found.summary() for found in each] for each in self.answers],
            "ranking": [ranked(score) for score in self.ranking],
            "threshold": self.threshold,
            "error": self.errors.summary(),
            "held_out": None if self.held_out is None else self.held_out.summary(),
            "residual": {
                "noise": self.after.noise,
                "correlation": self.after.correlation,
                "inconstancy": self.after.inconstancy,
            },
            "unexplained": None if self.where is None else self.where.summary(),
            "stand_in": None if self.stand_in is None else self.stand_in.summary(),
            "seconds": self.seconds,
        }


def ranked(score: Score) -> dict[str, Any]:
    """A line of the ranking, with sizes in their units."""
    candidate = score.candidate
    return {
        "effect": candidate.effect.name,
        "location": candidate.location,
        "score": score.score,
        "sizes": {
            parameter.name: {"value": size * typical, "unit": parameter.unit}
            for parameter, size, typical in zip(
                candidate.effect.sizes, score.sizes, candidate.typical, strict=True
            )
        },
        "smallest_detectable": score.smallest,
    }


def found(term: Term, deviations: Floats, by_step: Floats, robot: Robot) -> Found:
    """A term with what is known about its values, as `Uncertainty` has it."""
    values = tuple(
        _value(parameter, value, deviation, of_step)
        for parameter, value, deviation, of_step in zip(
            term.effect.parameters, term.values, deviations, by_step, strict=True
        )
    )
    return Found(term.effect.name, place_name(term.effect, term.place, robot), values, term)


def _value(parameter: Parameter, fitted: float, deviation: float, by_step: float) -> Value:
    least = 0.0 if parameter.one_sided else -np.inf
    value = max(fitted - by_step, least)
    low, high = (value + side * QUANTILE * deviation for side in (-1.0, 1.0))
    return Value(
        parameter.name, float(value), float(max(low, least)), float(high), parameter.unit, fitted
    )
