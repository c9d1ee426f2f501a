"""The answer of a diagnosis: a word, and effects with their values."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from flywheel.diagnosis.fitting.parameters import BELIEVED
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

    @property
    def certainty(self) -> float:
        """Largest of its sizes over its interval's width."""
        sizes = self.values[: len(self.term.effect.sizes)]
        return max(abs(v.value) / max(v.high - v.low, 1e-300) for v in sizes)

    @property
    def held_back(self) -> bool:
        """A value ended as far from what was said of it as that is believed."""
        # A step that ends at a bound may miss it by a rounding.
        known = zip(self.term.values, self.term.known, strict=False)
        return any(abs(value) > 0.999 * BELIEVED * deviation for value, deviation in known)

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return {
            "effect": self.effect,
            "location": self.location,
            "parameters": {v.name: v.summary() for v in self.values},
        }


Alternative = tuple[Found, ...]


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
