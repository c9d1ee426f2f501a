"""Scales of a robot: sizes of effects are relative to these."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Self

from flywheel.robots import GRAVITY, Robot


@dataclass(frozen=True)
class Scales:
    """Natural units of a robot.

    Attributes:
      length: the robot's characteristic length [m].
      mass: of all its bodies [kg].
      cap: largest radius of the spheres around its tracked points [m]; a hundredth of `length`
        without any.
      bodies: their number.
    """

    length: float
    mass: float
    cap: float
    bodies: int

    @classmethod
    def of(cls, robot: Robot) -> Self:
        """The scales of a robot."""
        cap = max((point.radius for point in robot.points), default=0.0)
        return cls(
            length=robot.length,
            mass=sum(body.mass for body in robot.bodies),
            cap=cap or 0.01 * robot.length,
            bodies=len(robot.bodies),
        )

    @property
    def weight(self) -> float:
        """Weight of all bodies [N]."""
        return self.mass * GRAVITY

    @property
    def time(self) -> float:
        """Natural time sqrt(L / g), about that of a fall from the robot's height [s]."""
        return sqrt(self.length / GRAVITY)

    @property
    def slow(self) -> float:
        """Speed below which a cable counts as still, in friction laws [m/s]."""
        return 0.01 * self.length / self.time
