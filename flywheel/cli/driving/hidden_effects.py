"""Plants with hidden effects: stand-ins for real robots, for rehearsals."""

from __future__ import annotations

from collections.abc import Mapping

from flywheel.cli.models import adopted_file
from flywheel.cli.options import number
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.effects import EFFECTS, AdoptedPlant, Effect, WrittenTerm
from flywheel.effects.own import check_given, law_files
from flywheel.errors import ConfigError
from flywheel.quantities import Bounds
from flywheel.registry import lookup
from flywheel.robots import Robot
from flywheel.runtime.workers.episode_plan import Effects

TIMES = Bounds(-1000, 1000)
SIZE = ":"  # between an effect and how many times its typical size


def hidden_effects(
    wanted: tuple[str, ...], robot: Robot, library: Mapping[str, Effect] = EFFECTS
) -> Effects:
    """Hidden effects of a plant.

    Args:
      wanted: effects of the library by name, "torque_speed", with their place,
        "weak_cable@long_03", and a multiple of the typical size, "torque_speed:2"; or paths of
        adopted plants.
      robot: of the plant.
      library: of the names.

    Raises:
      UnknownNameError: no such effect or place.
      ConfigError: not a size, a plant of another robot, or one whose law file is not in the library.
    """
    known = {candidate.name: candidate for candidate in candidates(robot, library)}
    found: list[WrittenTerm] = []
    for text in wanted:
        if (file := adopted_file(text)) is not None:
            plant, its = AdoptedPlant.read(file)
            if its.digest != robot.digest:
                raise ConfigError(f"{text} was adopted for {its.name}, not for {robot.name}.")
            check_given(plant.effects_from, law_files(library.values()), f"The plant {text}")
            found += plant.effects
            continue
        name, colon, size = text.partition(SIZE)
        candidate = lookup(known, name, "hidden effect")
        what = f"{text}: the multiple of the typical size, as in {name}{SIZE}2,"
        times = number(size, what, TIMES) if colon else 1.0
        term = candidate.term(tuple(times for _ in candidate.typical))
        found.append(WrittenTerm.of(term, robot))
    return tuple(found)
