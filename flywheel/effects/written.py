"""Effects with their values in written form: in YAML, JSON and run configurations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import Field

from flywheel.effects.effect import Effect, Term, parts_of, place_name
from flywheel.effects.per_part import PerPart, has_factors, per_part
from flywheel.errors import ConfigError
from flywheel.quantities import Bounds, Name
from flywheel.registry import lookup
from flywheel.robots import Robot
from flywheel.validation import Frozen

AT = " at "
MOST_PARAMETERS = 1000  # a size for each of many cables
# In any unit: a cable of a suspension bridge has 1e10 N/m.
Value = Annotated[float, Bounds(-1e12, 1e12)]


class WrittenTerm(Frozen):
    """An effect at a place, with its values, by names.

    Attributes:
      effect: its name in the library.
      location: name of the cable or tracked point; "" for the whole robot.
      parameters: name -> value of every parameter, in the effect's units.
    """

    effect: Name
    location: Name = ""
    parameters: dict[Name, Value] = Field(max_length=MOST_PARAMETERS)

    @classmethod
    def of(cls, term: Term, robot: Robot) -> Self:
        """The written form of a term."""
        location = place_name(term.effect, term.place, robot)
        return cls(effect=term.effect.name, location=location, parameters=term.named)

    @classmethod
    def labelled(cls, label: str, parameters: Mapping[str, float]) -> Self:
        """Parse the format of `label`."""
        effect, _, location = label.partition(AT)
        return cls(effect=effect, location=location, parameters=dict(parameters))

    @property
    def label(self) -> str:
        """Readable name, also kept in provenance: "weak_cable at long_03"."""
        return f"{self.effect}{AT}{self.location}" if self.location else self.effect

    def __hash__(self) -> int:
        return hash((self.effect, self.location, *self.parameters.items()))

    def term(self, robot: Robot, library: Mapping[str, Effect]) -> Term:
        """Look up the term in a library of effects.

        Raises:
          UnknownNameError: no such effect, place or parameter.
          ConfigError: a parameter is missing, or has an impossible sign.
          RobotError: the robot has nothing on which the effect acts.
        """
        effect = lookup(library, self.effect, "effect")
        effect.require_place(robot)
        if has_factors(self.parameters):
            effect = per_part(effect, robot) or effect
        places = {place_name(effect, place, robot): place for place in effect.places(robot)}
        if effect.part != effect.where and not isinstance(effect, PerPart):  # at one part alone
            names = parts_of(robot, effect.part)
            places |= {names[place]: place for place in effect.parts_on(robot)}
        elif "" in places and self.location:
            raise ConfigError(
                f"{self.effect} is of the whole robot: it has no location, got {self.location!r}."
            )
        place = lookup(places, self.location, f"place of {self.effect} on {robot.name}")
        known = {parameter.name: parameter for parameter in effect.parameters}
        for name, value in self.parameters.items():
            parameter = lookup(known, name, f"parameter of {self.effect}")
            if parameter.one_sided and value < 0:
                raise ConfigError(
                    f"{name} of {self.effect} cannot be negative [{parameter.unit}], got {value!r}."
                )
        if missing := [name for name in known if name not in self.parameters]:
            raise ConfigError(f"{self.effect} also needs {', '.join(missing)}.")
        return Term(effect, place, tuple(float(self.parameters[name]) for name in known))
