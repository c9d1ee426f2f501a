"""Plants with effects that nobody is told of: stand-ins for real robots, to rehearse with."""

from __future__ import annotations

from pathlib import Path

from flywheel.diagnosis.candidates import candidates
from flywheel.effects import EFFECTS, AdoptedPlant, WrittenTerm
from flywheel.errors import ConfigError
from flywheel.registry import lookup
from flywheel.robots import Robot
from flywheel.runtime.plan import Effects

SIZE = ":"  # between an effect and how many times its typical size


def hidden_effects(wanted: tuple[str, ...], robot: Robot) -> Effects:
    """What a plant is to have without anybody being told.

    Args:
      wanted: effects of the library by name, "torque_speed", with their place, "weak_cable@long_03", and
        how many times the typical size, "torque_speed:2"; or paths of adopted plants.
      robot: of the plant.

    Raises:
      UnknownNameError: no such effect or place.
      ConfigError: not a size, or a plant of another robot.
    """
    known = {candidate.name: candidate for candidate in candidates(robot, EFFECTS)}
    found: list[WrittenTerm] = []
    for text in wanted:
        if Path(text).exists():
            plant, its = AdoptedPlant.read(text)
            if its.digest != robot.digest:
                raise ConfigError(f"{text} was adopted for {its.name}, not for {robot.name}.")
            found += plant.effects
            continue
        name, colon, size = text.partition(SIZE)
        candidate = lookup(known, name, "hidden effect")
        try:
            times = float(size) if colon else 1.0
        except ValueError:
            raise ConfigError(
                f"{text}: after {SIZE!r} comes how many times the typical size, e.g. {name}:2, got "
                f"{size!r}."
            ) from None
        term = candidate.term(tuple(times for _ in candidate.typical))
        found.append(WrittenTerm.of(term, robot))
    return tuple(found)
