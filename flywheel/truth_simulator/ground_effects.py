"""Hidden effects of the ground: friction, rolling, softness and tilt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from flywheel.robots import Robot
from flywheel.truth_simulator.effect import GroundEffect, ModelEffect, random_direction
from flywheel.truth_simulator.scales import Scales


@dataclass(frozen=True)
class GroundFriction(GroundEffect, ModelEffect):
    """Contacts with another friction: all coefficients times (1 + f)."""

    name = "ground_friction"
    units: ClassVar = {"share": "-"}
    share: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(float(rng.choice((-0.25, 0.25))))

    def edit(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        rub(spec, 1.0 + self.share)


@dataclass(frozen=True)
class RollingResistance(GroundEffect, ModelEffect):
    """Contacts that resist rolling, with a lever arm rho."""

    name = "rolling_resistance"
    units: ClassVar = {"length": "m"}
    length: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.1 * Scales.of(robot).cap_radius)

    def edit(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        if not self.length:
            return
        for geom in spec.geoms:
            geom.friction = np.array(geom.friction) + (0.0, 0.0, self.length)
        for pair in spec.pairs:  # in both directions
            pair.friction = np.array(pair.friction) + (0.0, 0.0, 0.0, self.length, self.length)
        for each in (*spec.geoms, *spec.pairs):
            each.condim = 6  # the only kind of contact that knows rolling


@dataclass(frozen=True)
class Slope(ModelEffect):
    """Sloped ground: gravity leans, relative to the floor."""

    name = "slope"
    units: ClassVar = {"about_x": "rad", "about_y": "rad"}
    sized: ClassVar = ("about_x", "about_y")
    about_x: float
    about_y: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        x, y = 0.03 * random_direction(rng, 2)
        return cls(float(x), float(y))

    def edit(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        strength = float(np.linalg.norm(spec.option.gravity))
        across = np.array([np.sin(self.about_y), -np.sin(self.about_x)])
        down = -np.sqrt(1.0 - across @ across)
        spec.option.gravity = strength * np.array([*across, down])


@dataclass(frozen=True)
class ContactSoftness(GroundEffect, ModelEffect):
    """Contacts of stiffness / (1 + s), at the same damping ratio."""

    name = "contact_softness"
    units: ClassVar = {"share": "-"}
    share: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(1.0)

    def edit(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        soften(spec, 1.0 + self.share)


def rub(spec: mujoco.MjSpec, times: float) -> None:
    """Multiply all coefficients of friction."""
    for each in (*spec.geoms, *spec.pairs):
        each.friction = np.array(each.friction) * times


def soften(spec: mujoco.MjSpec, softer: float) -> None:
    """Divide the stiffness of all contacts, at the same damping ratio."""
    for each in (*spec.geoms, *spec.pairs):
        each.solref = _softened(softer, *each.solref)
    for pair in spec.pairs:
        pair.solreffriction = _softened(softer, *pair.solreffriction)


def _softened(softer: float, first: float, second: float) -> tuple[float, float]:
    if first < 0:  # (-stiffness, -damping)
        return first / softer, second / float(np.sqrt(softer))
    return first * float(np.sqrt(softer)), second  # (time constant, damping ratio)
