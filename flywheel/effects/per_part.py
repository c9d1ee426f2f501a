"""An effect whose size differs from cable to cable, or from winch to winch.

Every part has the effect's size times a factor. These factors have a prior near one. They are drawn
to the common size if the data contain little information on them (shrinkage), and the effect costs
an explanation little more than one of the same size everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from flywheel.effects.effect import (
    Cables,
    CommandEffect,
    Effect,
    Memory,
    Parameter,
    TensionEffect,
    Term,
    Values,
    Where,
    WinchEffect,
    Winches,
    parts_of,
)
from flywheel.effects.scales import Scales
from flywheel.records import Floats
from flywheel.robots import Robot

LOG_FACTOR = "log_factor@"  # before the name of a part
FARTHEST = 4.0  # of the logarithm of a factor: one part has it and the others hardly


def per_part(effect: Effect, robot: Robot) -> PerPart | None:
    """An effect with a size for each part; None for one that is not of cables or winches, or of one
    part only.
    """
    if isinstance(effect, PerPart) or effect.where != "robot" or len(effect.sizes) != 1:
        return None
    cables, winches = parts_of(robot, "cable"), parts_of(robot, "winch")
    if isinstance(effect, TensionEffect) and len(cables) > 1:
        return TensionPerPart(effect, cables, "cable")
    if isinstance(effect, CommandEffect) and len(winches) > 1:
        return CommandPerPart(effect, winches, "winch")
    if isinstance(effect, WinchEffect) and len(winches) > 1:
        return RatePerPart(effect, winches, "winch")
    return None


def per_part_term(term: Term, robot: Robot, deviation: float) -> Term | None:
    """A term with a factor for each part, whose logarithm has a prior standard deviation.

    All are one; for a term at a part alone, that part is two standard deviations above the others.
    """
    effect = per_part(term.effect, robot)
    if effect is None:
        return None
    logs = np.zeros(len(effect.parts))
    (size, *shapes) = term.values
    if term.place is not None:
        logs -= deviation
        logs[term.place] = deviation
        size *= math.exp(-deviation)
    known = (math.inf,) * len(term.values) + (deviation,) * len(logs)
    return Term(effect, None, (size, *shapes, *logs.tolist()), known)


def acts_on_same_parts(effect: Effect, model: Term, robot: Robot) -> bool:
    """True if an effect can have the factors of a term."""
    uneven = per_part(effect, robot)
    return (
        uneven is not None
        and isinstance(model.effect, PerPart)
        and uneven.parts == model.effect.parts
    )


def alike(term: Term, model: Term, robot: Robot) -> Term:
    """A term with the factors and the price of another one, if it has any and both act on the same parts."""
    effect = per_part(term.effect, robot)
    if effect is None or not acts_on_same_parts(term.effect, model, robot):
        return term
    count = len(effect.parts)
    known = (math.inf,) * len(term.values) + model.known[-count:]
    return replace(model, effect=effect, values=term.values + model.values[-count:], known=known)


def at_largest_part(term: Term) -> tuple[Term, float]:
    """A term at the part with the largest size, without factors; and that part's share of the sum
    of all.
    """
    effect = term.effect
    assert isinstance(effect, PerPart)
    count = len(effect.parts)
    factors = np.exp(term.values[-count:])
    place, (size, *rest) = int(np.argmax(factors)), term.values[:-count]
    values = (size * float(factors[place]), *rest)
    return Term(effect.even, place, values), float(factors[place] / factors.sum())


def at_same_size(term: Term) -> Term:
    """A term with the geometric mean of its sizes at every part, without factors."""
    effect = term.effect
    assert isinstance(effect, PerPart)
    count = len(effect.parts)
    (size, *rest), logs = term.values[:-count], term.values[-count:]
    return Term(effect.even, None, (size * math.exp(float(np.mean(logs))), *rest))


class PerPart(Effect):
    """Base of effects whose size differs from part to part.

    Args:
      effect: of the same size everywhere.
      parts: names of the parts with factors.
      where: their kind.
    """

    def __init__(self, effect: Effect, parts: tuple[str, ...], where: Where) -> None:
        self.even, self.parts = effect, parts
        self.name, self.equation, self.source = effect.name, effect.equation, effect.source  # type: ignore[misc]
        self.shown_by = f"{effect.shown_by}, one {where} after the other"  # type: ignore[misc]
        self.form = f"{effect.form}, different" if effect.form else "different"  # type: ignore[misc]
        self.form += f" from {where} to {where}"  # type: ignore[misc]
        self.sizes = effect.sizes  # type: ignore[misc]
        self.shapes = (*effect.shapes, *map(_log_factor, parts))  # type: ignore[misc]

    @property
    def family(self) -> str:
        return self.even.family

    @cached_property
    def _own(self) -> tuple[str, ...]:
        """Names of the parameters that the effect has without factors."""
        return tuple(parameter.name for parameter in self.even.parameters)

    def apart(self, values: Values) -> dict[str, Floats]:
        """Values (n, parts) of the effect itself, from those with factors."""
        logs = np.stack(
            [values[f"{LOG_FACTOR}{part}"][:, i] for i, part in enumerate(self.parts)], 1
        )
        size = self.even.sizes[0].name
        own = {name: values[name] for name in self._own}
        return {**own, size: own[size] * np.exp(logs)}


class TensionPerPart(PerPart, TensionEffect):
    """On the tension of cables."""

    def __init__(self, effect: TensionEffect, parts: tuple[str, ...], where: Where) -> None:
        super().__init__(effect, parts, where)
        self.even: TensionEffect = effect
        self.remembers = effect.remembers  # type: ignore[misc]

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return self.even.tension(cables, memory, self.apart(values))


class CommandPerPart(PerPart, CommandEffect):
    """On the commands of winches."""

    def __init__(self, effect: CommandEffect, parts: tuple[str, ...], where: Where) -> None:
        super().__init__(effect, parts, where)
        self.even: CommandEffect = effect
        self.stage = effect.stage  # type: ignore[misc]

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        return self.even.command(controls, self.apart(values), robot, dt)


class RatePerPart(PerPart, WinchEffect):
    """On the rates of winches."""

    def __init__(self, effect: WinchEffect, parts: tuple[str, ...], where: Where) -> None:
        super().__init__(effect, parts, where)
        self.even: WinchEffect = effect

    def rate(self, rate: Floats, winches: Winches, values: Values) -> Floats:
        return self.even.rate(rate, winches, self.apart(values))


def _log_factor(part: str) -> Parameter:
    return Parameter(f"{LOG_FACTOR}{part}", "-", _one, low=-FARTHEST, high=FARTHEST)


def _one(scales: Scales) -> float:
    return 1.0


def has_factors(parameters: Mapping[str, float]) -> bool:
    """True if written parameters belong to an effect whose size differs from part to part."""
    return any(name.startswith(LOG_FACTOR) for name in parameters)
