"""What a diagnosis says: the verdict and everything it rests on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from flywheel.diagnosis.adequacy import Adequacy
from flywheel.diagnosis.evidence import Evidence
from flywheel.diagnosis.score import Score
from flywheel.effects import Term, place_name
from flywheel.robots import Robot


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
    """A fitted number with its 95 % interval."""

    name: str
    value: float
    low: float
    high: float
    unit: str


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

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "effect": self.effect,
            "location": self.location,
            "parameters": {
                v.name: {"value": v.value, "low": v.low, "high": v.high, "unit": v.unit}
                for v in self.values
            },
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

    @property
    def exit_code(self) -> int:
        """Of the command."""
        return EXIT_CODES[self.verdict]

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "verdict": str(self.verdict),
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


def found(term: Term, deviations: Sequence[float], robot: Robot, quantile: float = 1.96) -> Found:
    """A term with standard deviations of all its values."""
    values = tuple(
        Value(
            parameter.name,
            value,
            max(value - quantile * deviation, 0.0)
            if parameter.one_sided
            else value - quantile * deviation,
            value + quantile * deviation,
            parameter.unit,
        )
        for parameter, value, deviation in zip(
            term.effect.parameters, term.values, deviations, strict=True
        )
    )
    return Found(term.effect.name, place_name(term.effect, term.place, robot), values, term)
