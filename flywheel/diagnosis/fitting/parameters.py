"""Values of effects that a fit may change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from flywheel.diagnosis.settings import FittingSettings
from flywheel.effects import Scales, Terms, is_number_of, taken_apart

# Step of a value of an effect, in typical sizes: a secant, as friction and play have no derivative at zero.
STEP = 0.25

Key = tuple[str, int | None, int]


@dataclass(frozen=True)
class FreeParameter:
    """One value of one term.

    Attributes:
      term, index: entry `index` of the values of term `term`.
      unit: one step of the fit.
      low, high: bounds.
      step: of a finite difference, in units.
      prior: standard deviation of its prior, around zero, in units.
    """

    term: int
    index: int
    unit: float
    low: float
    high: float
    step: float
    prior: float = inf

    def key(self, terms: Terms) -> Key:
        """Unique key: effect, place, and index."""
        term = terms[self.term]
        return term.effect.name, term.place, self.index

    def value(self, terms: Terms) -> float:
        """Its value in terms, in units."""
        return terms[self.term].values[self.index] / self.unit

    def room(self, terms: Terms) -> tuple[float, float]:
        """Largest move down (at most 0) and up (at least 0), in units."""
        value = self.value(terms)
        return min(0.0, self.low / self.unit - value), max(0.0, self.high / self.unit - value)

    def moved(self, terms: Terms, steps: float) -> Terms:
        """The terms with this value moved by so many units, within its bounds."""
        term = terms[self.term]
        values = list(term.values)
        moved = values[self.index] + steps * self.unit
        values[self.index] = float(np.clip(moved, self.low, self.high))
        changed = replace(term, values=tuple(values))
        return (*terms[: self.term], changed, *terms[self.term + 1 :])

    def step_from(self, terms: Terms) -> float:
        """Units of a finite difference: backwards at a bound, less between narrow ones."""
        down, up = self.room(terms)
        if up >= self.step or down == up:
            return self.step
        return max(down, -self.step) if -down > up else up


def free_parameters(
    terms: Terms, scales: Scales, believed: float = FittingSettings().believed
) -> list[FreeParameter]:
    """All values of all terms: sizes, then shapes, term by term.

    Numbers of a robot as built at the place of a candidate effect stay zero: they are the same
    quantity, and the effect has no prior.

    Args:
      terms: of the values.
      scales: of the robot.
      believed: largest allowed deviation from a prior, in standard deviations.
    """
    asked = [term for term in terms if term.asked]
    found = []
    for number, term in enumerate(terms):
        parts = [part for part in taken_apart((term,)) for _ in part.values]
        for index, (parameter, part) in enumerate(zip(term.effect.parameters, parts, strict=True)):
            deviation = term.known[index] if term.known else inf
            typical, most = parameter.typical(scales), believed * deviation
            low, high = max(parameter.low * typical, -most), min(parameter.high * typical, most)
            value = FreeParameter(number, index, typical, low, high, STEP, deviation / typical)
            if any(is_number_of(part, each) for each in asked):
                value = replace(value, low=0.0, high=0.0)
            found.append(value)
    return found


def prior_cost(terms: Terms) -> float:
    """Squares of values relative to their priors."""
    return sum(
        (value / deviation) ** 2
        for term in terms
        for value, deviation in zip(term.values, term.known, strict=False)
    )
