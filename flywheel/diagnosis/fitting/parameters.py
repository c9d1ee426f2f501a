"""Values of terms that a fit may change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from flywheel.effects import Parameter, Scales, Terms

BELIEVED = 3.0  # standard deviations of what is known of a value, that it may be off
STEP = 0.25  # a secant, not a derivative: friction and play have none at zero


@dataclass(frozen=True)
class Free:
    """One value of one term.

    Attributes:
      term, index: entry `index` of the values of term `term`.
      unit: one step of the fit.
      low, high: bounds.
      step: of a finite difference, in units.
      prior: standard deviation of what is known about it before any fit, around zero, in units.
    """

    term: int
    index: int
    unit: float
    low: float
    high: float
    step: float = STEP
    prior: float = inf

    def value(self, terms: Terms) -> float:
        """In units."""
        return terms[self.term].values[self.index] / self.unit

    def room(self, terms: Terms) -> tuple[float, float]:
        """How far it may move down (at most 0) and up (at least 0), in units."""
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
        """Units for a finite difference: backwards where a bound is in the way, less between narrow ones."""
        down, up = self.room(terms)
        if up >= self.step:
            return self.step
        return max(down, -self.step) if -down > up else up


def free_values(terms: Terms, scales: Scales, shapes: bool = True) -> list[Free]:
    """All sizes of all terms, and their shapes."""
    found = []
    for number, term in enumerate(terms):
        sizes = len(term.effect.sizes)
        for index, parameter in enumerate(term.effect.parameters):
            if index < sizes or shapes:
                deviation = term.known[index] if term.known else inf
                found.append(_free(number, index, parameter, deviation, scales))
    return found


def _free(term: int, index: int, parameter: Parameter, deviation: float, scales: Scales) -> Free:
    typical = parameter.typical(scales)
    low = max(parameter.low * typical, -BELIEVED * deviation)
    high = min(parameter.high * typical, BELIEVED * deviation)
    return Free(term, index, typical, low, high, prior=deviation / typical)


def term_cost(terms: Terms) -> float:
    """What is known of values before, as squares."""
    return sum(
        (value / deviation) ** 2
        for term in terms
        for value, deviation in zip(term.values, term.known, strict=False)
    )
