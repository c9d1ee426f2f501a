"""Hidden effects as text: `torque_speed`, `weak_cable@long_03`, `payload:2`."""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Sequence

import numpy as np

from flywheel.errors import ConfigError
from flywheel.registry import lookup
from flywheel.robots import Robot
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.effect import HiddenEffect

PLACE, SIZE = "@", ":"
LARGEST = 1000.0  # times the typical size


def hidden_effects(texts: Sequence[str], robot: Robot) -> tuple[HiddenEffect, ...]:
    """The effects of their texts, `NAME[@PLACE][:SIZE]`. Random draws depend on the text alone.

    Args:
      texts: a place is the name of a cable or point; a size of 2 is twice the typical one.
      robot: with the effects.

    Raises:
      UnknownNameError: no such effect, cable or point.
      ConfigError: no size, or an effect that cannot be at a place or on this robot.
    """
    return tuple(_effect(text, robot) for text in texts)


def _effect(text: str, robot: Robot) -> HiddenEffect:
    rest, colon, size = text.partition(SIZE)
    name, at, place = rest.partition(PLACE)
    kind = hidden_effect(name)
    if not kind.applies(robot):
        raise ConfigError(f"{name} has no influence on {robot.name}: leave it out.")
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    effect = kind.typical(robot, rng).scaled(_size(text, size) if colon else 1.0)
    return _placed(effect, place, robot) if at else effect


def _size(text: str, size: str) -> float:
    try:
        number = float(size)
    except ValueError:
        number = math.nan
    if not 0 <= number <= LARGEST:
        raise ConfigError(
            f"{text}: the number after the colon is a multiple of the typical size, from 0 to "
            f"{LARGEST:g}, got {size!r}."
        )
    return number


def _placed(effect: HiddenEffect, place: str, robot: Robot) -> HiddenEffect:
    names = {"cable": [c.name for c in robot.cables], "point": [p.name for p in robot.points]}
    for field, there in names.items():
        if hasattr(effect, field):
            number = lookup({name: i for i, name in enumerate(there)}, place, field)
            return dataclasses.replace(effect, **{field: number})
    raise ConfigError(f"{effect.name} has no place: leave out {PLACE}{place}.")
