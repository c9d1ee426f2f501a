"""A task: where to go, by when, among what, and what a predicted motion costs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flywheel.records import Floats
from flywheel.robots import Box, Robot
from flywheel.tasks.center import center_weights


class Distance(Protocol):
    """How far it is from a place to the goal."""

    def __call__(self, places: Floats) -> Floats:
        """Distance (...) from places (..., 2) on the ground to the goal [m]."""
        ...


class Cost(Protocol):
    """One term of a cost. Terms add; no term at all costs nothing."""

    def __call__(self, points: Floats, task: Task) -> Floats:
        """Cost (B,) of predicted points (B, H + 1, P, 3) in a task; dimensionless."""
        ...


@dataclass(frozen=True)
class Task:
    """Bring the robot's centre of mass to a goal on the ground.

    Attributes:
      name: of its kind, as in `TASKS`.
      robot: that it is for.
      goal: (2,) place on the ground [m].
      tolerance: straight distance at which the goal counts as reached [m].
      seconds: time limit [s].
      to_goal: the distance that the costs see, around obstacles where there are any.
      costs: terms of the cost.
      obstacles: boxes on the way; the plant needs the same ones.
    """

    name: str
    robot: Robot
    goal: Floats
    tolerance: float
    seconds: float
    to_goal: Distance
    costs: tuple[Cost, ...] = ()
    obstacles: tuple[Box, ...] = ()

    @cached_property
    def _weights(self) -> Floats:
        return center_weights(self.robot)

    def place(self, points: Floats) -> Floats:
        """Where the robot is: (..., 2) of its centre of mass, for points (..., P, 3) [m]."""
        return np.einsum("p,...pi->...i", self._weights, points[..., :2])

    def distance(self, points: Floats) -> Floats:
        """Straight distance (...) of the centre of mass to the goal, for points (..., P, 3) [m]."""
        return np.linalg.norm(self.place(points) - self.goal, axis=-1)

    def reached(self, points: Floats) -> NDArray[np.bool_]:
        """(...) whether the goal is reached, for points (..., P, 3)."""
        return self.distance(points) <= self.tolerance

    def cost(self, points: Floats) -> Floats:
        """Cost (B,) of predicted points (B, H + 1, P, 3): the sum of the terms."""
        total = np.zeros(len(points))
        for term in self.costs:
            total = total + term(points, self)
        return total
