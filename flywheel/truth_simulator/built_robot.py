"""A robot as built: every number of its MJCF is slightly off, part by part."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.cable_law import CableLaw
from flywheel.truth_simulator.effect import BuildEffect, ModelEffect, RestEffect, WinchEffect
from flywheel.truth_simulator.ground_effects import rub, soften
from flywheel.truth_simulator.scales import Scales


@dataclass(frozen=True)
class Spread:
    """Standard deviations of robots' numbers from their MJCF.

    Factors are drawn on their logarithms, so that none is negative.

    Attributes:
      stiffness, damping: of each cable [-].
      rest: length of each cable [fraction of the robot's length].
      ends: attachment or anchor of each end of a cable, along each axis [fraction of the length].
      mass: of each body, with its inertia [-].
      friction, contact_stiffness: of all contacts [-].
      gain: of each winch [-].
    """

    stiffness: float = 0.05
    damping: float = 0.3
    rest: float = 0.003
    ends: float = 0.003
    mass: float = 0.03
    friction: float = 0.15
    contact_stiffness: float = 0.3
    gain: float = 0.02

    def times(self, factor: float) -> Spread:
        """Multiplied by a factor."""
        values = dataclasses.asdict(self).items()
        return Spread(**{name: factor * value for name, value in values})


@dataclass(frozen=True, eq=False)
class AsBuilt(BuildEffect, ModelEffect, WinchEffect, RestEffect):
    """Deviations of one robot from its MJCF in all its parts at once.

    Attributes:
      stiffness, damping: (C,) logarithms of the cables' factors.
      rest: (C,) added to the cables' rest lengths [m].
      moved: (2C, 3) of the cables' ends, in the frames of their bodies [m].
      mass: (B,) logarithms of the bodies' factors.
      friction, contact_stiffness: logarithms of factors.
      gains: (W,) logarithms of the winches' factors.
    """

    name = "as_built"
    units: ClassVar = {}
    sized: ClassVar = (
        "stiffness", "damping", "rest", "moved", "mass", "friction", "contact_stiffness", "gains",
    )  # fmt: skip
    stiffness: Floats
    damping: Floats
    rest: Floats
    moved: Floats
    mass: Floats
    friction: float
    contact_stiffness: float
    gains: Floats

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls.drawn(robot, rng, Spread())

    @classmethod
    def drawn(cls, robot: Robot, rng: np.random.Generator, spread: Spread) -> Self:
        """One robot of many that were built from the same MJCF."""
        cables, length = len(robot.cables), Scales.of(robot).length
        return cls(
            stiffness=spread.stiffness * rng.normal(size=cables),
            damping=spread.damping * rng.normal(size=cables),
            rest=spread.rest * length * rng.normal(size=cables),
            moved=spread.ends * length * rng.normal(size=(2 * cables, 3)),
            mass=spread.mass * rng.normal(size=len(robot.bodies)),
            friction=float(spread.friction * rng.normal()),
            contact_stiffness=float(spread.contact_stiffness * rng.normal()),
            gains=spread.gain * rng.normal(size=len(robot.winches)),
        )

    def law(self, law: CableLaw) -> CableLaw:
        damping = np.exp(self.damping)
        return dataclasses.replace(
            law,
            stiffness=law.stiffness * np.exp(self.stiffness),
            damping=law.damping * damping,
            free_damping=law.free_damping * damping,
        )

    def ends(self, offsets: Floats) -> Floats:
        return offsets + self.moved

    def added(self, time: float, cables: int) -> Floats:
        return self.rest

    def limit(self, rate: Floats, load: Floats, motor: Floats) -> Floats:
        return rate * np.exp(self.gains)

    def edit(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        for body, factor in zip(robot.bodies, np.exp(self.mass).tolist(), strict=True):
            _weigh(spec.body(body.name), factor)
        rub(spec, float(np.exp(self.friction)))
        soften(spec, float(np.exp(-self.contact_stiffness)))


def _weigh(body: mujoco.MjsBody, factor: float) -> None:
    """Scale mass and inertia, given or derived from the geoms."""
    if body.explicitinertial:
        body.mass *= factor
        body.inertia = np.array(body.inertia) * factor
        body.fullinertia = np.array(body.fullinertia) * factor
    for geom in body.geoms:
        geom.density *= factor
        geom.mass *= factor  # NaN where it is not given
