"""Hidden effects on the bodies themselves: drag and added mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot, add_plain
from flywheel.truth_simulator.effect import BodyEffect, ModelEffect
from flywheel.truth_simulator.scales import Scales

SPECK = 1e-8  # inertia of a point mass, which MuJoCo wants above zero [m^2, times its mass]


@dataclass(frozen=True)
class AirDrag(BodyEffect):
    """A force -c v at the centre of mass of each body."""

    name = "air_drag"
    units: ClassVar = {"drag": "N s/m"}
    drag: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        return cls(0.1 * s.weight * s.time / s.length / s.bodies)

    def force(self, time: float, velocity: Floats, mass: Floats) -> Floats:
        return -self.drag * velocity


@dataclass(frozen=True)
class Payload(ModelEffect):
    """A point mass fixed at a tracked point."""

    name = "payload"
    units: ClassVar = {"mass": "kg"}
    mass: float
    point: int

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.02 * Scales.of(robot).mass, int(rng.integers(len(robot.points))))

    def edit(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        if not self.mass:
            return
        point = robot.points[self.point]
        body = spec.body(robot.bodies[point.body].name)
        # A welded body of its own: the carrier's mass may be given or inferred, both stay.
        load = add_plain(body, "body", pos=point.offset)
        load.mass, load.explicitinertial = self.mass, True
        load.ipos = [0.0, 0.0, 0.0]  # without it the compiler puts the mass at `pos` once more
        load.inertia = [SPECK * self.mass] * 3
