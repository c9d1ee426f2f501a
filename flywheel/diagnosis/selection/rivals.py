"""Effects between which somebody has to decide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flywheel.diagnosis.selection.candidates import AT, Candidate, candidates
from flywheel.effects import NAMED, Effect
from flywheel.errors import DataError
from flywheel.registry import lookup
from flywheel.robots import Robot


@dataclass(frozen=True)
class Rival:
    """An effect that may be the one, at a place or at any.

    Attributes:
      name: as it was asked for.
      candidates: the effect at each place that it may be at.
    """

    name: str
    candidates: tuple[Candidate, ...]

    @classmethod
    def named(cls, name: str, robot: Robot, library: Mapping[str, Effect] = NAMED) -> Rival:
        """Of "effect", at any place, or of "effect@place", at one.

        Raises:
          UnknownNameError: no such effect or place.
          DataError: a place for an effect that has none.
        """
        effect, at, place = name.partition(AT)
        found = candidates(robot, {effect: lookup(library, effect, "effect")})
        if not at:
            return cls(name, found)
        places = {candidate.location: candidate for candidate in found if candidate.location}
        if not places:
            raise DataError(f"{effect} is of the whole robot: name it without {AT}{place}.")
        return cls(name, (lookup(places, place, f"place of {effect}"),))
