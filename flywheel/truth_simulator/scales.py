"""The robot's scales, in which typical effect sizes are stated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.robots import Robot

EARTH = 9.81  # [m/s^2]


@dataclass(frozen=True)
class Scales:
    """Scales of this robot.

    Attributes:
      weight: of all bodies [N].
      mass: of all bodies [kg].
      length: `robot.length` [m].
      time: sqrt(length / g) [s], about half a swing of a pendulum of that length.
      bodies: their number.
      cap_radius: of its contact spheres [m]; 0 for a suspended robot.
    """

    weight: float
    mass: float
    length: float
    time: float
    bodies: int
    cap_radius: float

    @classmethod
    def of(cls, robot: Robot) -> Scales:
        mass = sum(body.mass for body in robot.bodies)
        return cls(
            weight=mass * EARTH,
            mass=mass,
            length=robot.length,
            time=float(np.sqrt(robot.length / EARTH)),
            bodies=len(robot.bodies),
            cap_radius=max((point.radius for point in robot.points), default=0.0),
        )

    @property
    def slow(self) -> float:
        """The speed below which dry friction fades out, 0.01 length / time [m/s]."""
        return 0.01 * self.length / self.time
