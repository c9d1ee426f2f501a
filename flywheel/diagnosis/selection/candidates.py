"""Candidates: every effect of a library, at every place, with every shape of its grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from flywheel.effects import Effect, Scales, Term, Terms, parts_of, place_name
from flywheel.robots import Robot

AT = "@"  # between an effect and its place, where people name them


@dataclass(frozen=True)
class Candidate:
    """One effect at one place.

    Attributes:
      effect: the effect.
      place: index of the cable or point; None for the whole robot.
      typical: usual value of every size.
      shapes: alternatives for the values of its shapes; one empty tuple without shapes.
      location: name of the place; "" for the whole robot.
    """

    effect: Effect
    place: int | None
    typical: tuple[float, ...]
    shapes: tuple[tuple[float, ...], ...]
    location: str

    @property
    def label(self) -> str:
        """For people: "weak_cable at long_03"."""
        return f"{self.effect.name} at {self.location}" if self.location else self.effect.name

    @property
    def name(self) -> str:
        """In the format of commands: "weak_cable@long_03"."""
        return f"{self.effect.name}{AT}{self.location}" if self.location else self.effect.name

    def term(self, sizes: tuple[float, ...], shape: int = 0) -> Term:
        """The effect with these sizes, in multiples of the typical ones, and this shape.

        An impossible size is replaced by the nearest possible one.
        """
        bounds = ((p.low, p.high) for p in self.effect.sizes)
        values = tuple(
            float(np.clip(size, low, high)) * typical
            for size, typical, (low, high) in zip(sizes, self.typical, bounds, strict=True)
        )
        return Term(self.effect, self.place, values + self.shapes[shape])

    def allows(self, values: tuple[float, ...]) -> bool:
        """True if the effect can have these sizes, in its own units; its shapes may follow them."""
        sizes = zip(values, self.effect.sizes, self.typical, strict=False)
        return all(size.low * usual <= value <= size.high * usual for value, size, usual in sizes)

    def unit_terms(self, share: float = 1.0) -> list[Term]:
        """Each size alone at a fraction of its typical value: shapes outside, sizes inside."""
        count = len(self.typical)
        units = [tuple(share * float(i == j) for j in range(count)) for i in range(count)]
        return [self.term(unit, shape) for shape in range(len(self.shapes)) for unit in units]


def candidates(robot: Robot, library: Mapping[str, Effect]) -> tuple[Candidate, ...]:
    """All candidates of a library for a robot."""
    scales = Scales.of(robot)
    found = []
    for effect in library.values():
        typical = tuple(size.typical(scales) for size in effect.sizes)
        grids = [[factor * s.typical(scales) for factor in s.grid or (1.0,)] for s in effect.shapes]
        shapes = tuple(product(*grids))
        for place in effect.places(robot):
            location = place_name(effect, place, robot)
            found.append(Candidate(effect, place, typical, shapes, location))
    return tuple(found)


def at_parts(robot: Robot, everywhere: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Candidates of the whole robot at each of its cables or winches alone, with their middle shapes."""
    return tuple(
        replace(each, place=place, shapes=(each.shapes[len(each.shapes) // 2],), location=name)
        for each in everywhere
        if each.place is None and each.effect.part not in ("robot", each.effect.where)
        for place in each.effect.parts_on(robot)
        for name in (parts_of(robot, each.effect.part)[place],)
    )


def places(terms: Terms) -> set[tuple[str, int | None]]:
    """Effects of terms, and their places."""
    return {(term.effect.name, term.place) for term in terms}


def families(terms: Terms) -> set[tuple[str, int | None]]:
    """Physical causes of candidate terms, and their places, by whatever law."""
    return {(term.effect.family, term.place) for term in terms if term.asked}
