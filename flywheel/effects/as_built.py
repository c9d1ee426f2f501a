"""A robot as built: many numbers of its MJCF at once, each slightly off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from flywheel.effects.effect import Effect, ModelEffect, Numbers, Parameter, Term, Terms, place_name
from flywheel.effects.scales import Scales
from flywheel.robots import Robot

NAME = "as_built"
FARTHEST = 10.0  # standard deviations


@dataclass(frozen=True)
class Part:
    """One uncertain number, or place, of a robot.

    Attributes:
      effect: that changes it.
      place: index of the part, or None.
      deviation: standard deviation of each of its values [their units].
    """

    effect: Effect
    place: int | None
    deviation: float

    @property
    def term(self) -> Term:
        """The MJCF's value."""
        count = len(self.effect.parameters)
        return Term(self.effect, self.place, (0.0,) * count, (self.deviation,) * count)


class AsBuilt(ModelEffect):
    """Several effects on MuJoCo's model as one, so that models need not be distinguished by
    hundreds of terms.

    Args:
      robot: whose parts they are.
      parts: of effects that are `ModelEffect`s.
    """

    name = NAME
    equation = "all numbers of the MJCF, each a little off"
    source = "tolerances of manufacture"
    shown_by = "everything"

    def __init__(self, robot: Robot, parts: Sequence[Part]) -> None:
        self.parts = tuple(parts)
        self.moves_mass = any(_model_effect(part).moves_mass for part in parts)  # type: ignore[misc]
        self.sizes = tuple(  # type: ignore[misc]
            _number(part, size, robot) for part in parts for size in part.effect.sizes
        )

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        numbers = iter(values.values())
        for part in self.parts:
            own = {size.name: next(numbers) for size in part.effect.sizes}
            if any(own.values()):
                _model_effect(part).edit(model, robot, part.place, own)

    def _split(self, numbers: np.ndarray) -> list[np.ndarray]:
        """The values of each part."""
        ends = np.cumsum([len(part.effect.sizes) for part in self.parts])
        return np.split(numbers, ends[:-1])

    def apart(self, term: Term) -> Terms:
        """A term of this effect as terms of its parts, with the same values in the same order."""
        values, known = (self._split(np.array(each)) for each in (term.values, term.known))
        return tuple(
            Term(part.effect, part.place, tuple(own.tolist()), tuple(sure.tolist()))
            for part, own, sure in zip(self.parts, values, known, strict=True)
        )


def taken_apart(terms: Terms) -> Terms:
    """Terms with those of a robot as built as terms of its parts; all values stay in their order."""
    found: list[Term] = []
    for term in terms:
        found += term.effect.apart(term) if isinstance(term.effect, AsBuilt) else [term]
    return tuple(found)


def handed_over(terms: Terms) -> Terms:
    """Terms in which candidate effects absorb the numbers of a robot as built at their place.

    The numbers are zero there then: the effect has no prior, so it need not be near zero. Sizes
    that cannot be negative stay.
    """
    for term in terms:
        said = _said(terms, term)
        if term.asked and said and not any(size.one_sided for size in term.effect.sizes):
            terms = tuple(_larger(t, said) if t is term else t for t in _saying(terms, term, ()))
    return terms


def handed_back(terms: Terms, term: Term) -> Terms:
    """Terms without one of them; numbers of a robot as built at its place take over its value."""
    rest = tuple(each for each in terms if each is not term)
    said = _said(rest, term)
    return _saying(rest, term, _larger(term, said).values[: len(said)]) if said else rest


def usual(term: Term, numbers: Terms, deviations: float) -> bool:
    """True if a term is within the tolerance of a number of a robot as built.

    Args:
      term: candidate.
      numbers: of the robot.
      deviations: allowed number of standard deviations.
    """
    known = next((n.known for n in taken_apart(numbers) if is_number_of(n, term)), ())
    return bool(known) and all(
        abs(size) <= deviations * known_to
        for size, known_to in zip(term.values, known, strict=False)
    )


def is_number_of(part: Term, term: Term) -> bool:
    """True if a part of a robot as built is the quantity of a candidate term."""
    return not part.asked and (part.effect.name, part.place) == (term.effect.name, term.place)


def _said(terms: Terms, term: Term) -> tuple[float, ...]:
    """Values of the numbers of a robot as built at the place of a term; empty without any."""
    parts = (part for part in taken_apart(terms) if is_number_of(part, term))
    return next((part.values for part in parts), ())


def _saying(terms: Terms, term: Term, said: tuple[float, ...]) -> Terms:
    """Terms whose numbers at the place of a term are `said`, or zero."""
    found: list[Term] = []
    for each in terms:
        parts = [
            replace(part, values=said or (0.0,) * len(part.values))
            if is_number_of(part, term)
            else part
            for part in taken_apart((each,))
        ]
        values = tuple(value for part in parts for value in part.values)
        found.append(each if values == each.values else replace(each, values=values))
    return tuple(found)


def _larger(term: Term, more: tuple[float, ...]) -> Term:
    """A term with larger sizes."""
    sizes, shapes = term.values[: len(more)], term.values[len(more) :]
    return replace(term, values=(*(s + m for s, m in zip(sizes, more, strict=True)), *shapes))


def together(robot: Robot, parts: Sequence[Part]) -> Terms:
    """Parts as few terms: those on MuJoCo's model as one."""
    native = [part for part in parts if isinstance(part.effect, ModelEffect)]
    others = [part.term for part in parts if not isinstance(part.effect, ModelEffect)]
    if not native:
        return tuple(others)
    effect = AsBuilt(robot, native)
    known = tuple(part.deviation for part in native for _ in part.effect.sizes)
    return (Term(effect, None, (0.0,) * len(known), known), *others)


def _number(part: Part, size: Parameter, robot: Robot) -> Parameter:
    """A size of a part, in standard deviations of its prior, within its own bounds."""

    def unit(scales: Scales) -> float:
        return part.deviation

    usual = size.typical(Scales.of(robot)) / part.deviation
    low, high = max(-FARTHEST, size.low * usual), min(FARTHEST, size.high * usual)
    name = f"{part.effect.name}@{place_name(part.effect, part.place, robot)}.{size.name}"
    return Parameter(name, size.unit, unit, low=low, high=high)


def _model_effect(part: Part) -> ModelEffect:
    assert isinstance(part.effect, ModelEffect)
    return part.effect
