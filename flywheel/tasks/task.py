"""A task: goal, time limit, obstacles, and the cost of a predicted motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flywheel.records import Floats
from flywheel.robots import Box, Robot
from flywheel.tasks.rolling import RollingWays


class Distance(Protocol):
    """Distance from a place to the goal."""

    def __call__(self, places: Floats) -> Floats:
        """Distance (...) from places (..., 2) on the ground to the goal [m]."""
        ...

    def astray(self, places: Floats) -> Floats:
        """Distance (...) from places (..., 2) to the nearest path that keeps clear of obstacles [m]."""
        ...


class Cost(Protocol):
    """One term of a cost. Terms are summed; an empty cost is 0."""

    def __call__(self, points: Floats, task: Task) -> Floats:
        """Cost (B,) of predicted points (B, H + 1, P, 3) in a task; dimensionless."""
        ...


@dataclass(frozen=True)
class Stand:
    """Position of a robot on the ground, and its rotation about the vertical.

    Attributes:
      place: (2,) of its centre of mass [m].
      turn: about the vertical, relative to the keyframe [rad].
    """

    place: Floats
    turn: float

    def points(self, points: Floats, weights: Floats) -> Floats:
        """Points (P, 3) of a robot placed there; (P,) weights of its centre of mass."""
        cosine, sine = np.cos(self.turn), np.sin(self.turn)
        around = points[:, :2] - weights @ points[:, :2]
        turned = around @ np.array([[cosine, sine], [-sine, cosine]])
        return np.concatenate([self.place + turned, points[:, 2:]], axis=1)


@dataclass(frozen=True)
class Task:
    """Bring the robot's centre of mass to a goal on the ground.

    Attributes:
      name: of its kind, as in `TASKS`.
      robot: for the task.
      goal: (2,) place on the ground [m].
      tolerance: straight distance at which the goal counts as reached [m].
      seconds: time limit [s].
      to_goal: the distance for the costs, around obstacles if there are any.
      costs: terms of the cost.
      obstacles: boxes on the way; the plant needs the same ones.
      begin: required initial position of the robot; None for its present one.
      rolling: the distance for the costs of a robot that has to turn; None for `to_goal`.
      then: next task, once the goal is reached; None for none.
    """

    name: str
    robot: Robot
    goal: Floats
    tolerance: float
    seconds: float
    to_goal: Distance
    costs: tuple[Cost, ...] = ()
    obstacles: tuple[Box, ...] = ()
    begin: Stand | None = None
    rolling: RollingWays | None = None
    then: Task | None = None

    @property
    def last_goal(self) -> Floats:
        """(2,) the last goal [m]."""
        return self.goal if self.then is None else self.then.last_goal

    def place(self, points: Floats) -> Floats:
        """Position of the robot: (..., 2) of its centre of mass, for points (..., P, 3) [m]."""
        return np.einsum("p,...pi->...i", self.robot.center_weights, points[..., :2])

    def way_left(self, points: Floats) -> Floats:
        """Distance (...) to the goal for the costs, for points (..., P, 3) [m]."""
        place = self.place(points)
        return self.to_goal(place) if self.rolling is None else self.rolling(points, place)

    def distance(self, points: Floats) -> Floats:
        """Straight distance (...) of the centre of mass to the goal, for points (..., P, 3) [m]."""
        return np.linalg.norm(self.place(points) - self.goal, axis=-1)

    def reached(self, points: Floats) -> NDArray[np.bool_]:
        """(...) bool: True if the goal is reached, for points (..., P, 3)."""
        return self.distance(points) <= self.tolerance

    def cost(self, points: Floats) -> Floats:
        """Cost (B,) of predicted points (B, H + 1, P, 3): the sum of the terms."""
        total = np.zeros(len(points))
        for term in self.costs:
            total = total + term(points, self)
        return total
