"""Terms of a cost. Lengths are in robot lengths, so that weights fit robots of any size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Box, Robot
from flywheel.tasks.task import Task

NEAREST = 0.02  # least gap that counts [robot lengths]: touching costs much, but not infinity


@dataclass(frozen=True)
class MeanDistance:
    """Distance to the goal, averaged over the horizon: `weight` per robot length."""

    weight: float

    def __call__(self, points: Floats, task: Task) -> Floats:
        """Cost (B,) of points (B, H + 1, P, 3)."""
        return self.weight * task.way_left(points).mean(axis=1) / task.robot.length


@dataclass(frozen=True)
class FinalDistance:
    """Distance to the goal at the end of the horizon: `weight` per robot length."""

    weight: float

    def __call__(self, points: Floats, task: Task) -> Floats:
        """Cost (B,) of points (B, H + 1, P, 3)."""
        return self.weight * task.way_left(points[:, -1]) / task.robot.length


@dataclass(frozen=True)
class Arrival:
    """A reward of `weight` for reaching the goal at any time within the horizon."""

    weight: float

    def __call__(self, points: Floats, task: Task) -> Floats:
        """Cost (B,) of points (B, H + 1, P, 3)."""
        return np.where(task.reached(points).any(axis=1), -self.weight, 0.0)


@dataclass(frozen=True)
class Broadside:
    """Fraction of the robot's spread on the ground along the way to the goal: 0 to `weight`.

    An elongated robot rolls across its long side, and has to turn first if the goal lies beyond its
    end; the distance alone does not reward this. For a round robot the term is constant. It fades
    within a robot length of the goal. Evaluated at the end of the horizon, along the straight way.
    """

    weight: float

    def __call__(self, points: Floats, task: Task) -> Floats:
        """Cost (B,) of points (B, H + 1, P, 3)."""
        last = points[:, -1, :, :2]
        way = task.goal - task.place(points[:, -1])
        far = np.linalg.norm(way, axis=-1)
        ahead = way / np.maximum(far, 1e-9)[:, None]
        offsets = last - last.mean(axis=1, keepdims=True)
        along = (np.einsum("bpi,bi->bp", offsets, ahead) ** 2).sum(axis=1)
        share = along / np.maximum((offsets**2).sum(axis=(1, 2)), 1e-12)
        return self.weight * share * np.minimum(far / task.robot.length, 1.0)


@dataclass(frozen=True)
class Collision:
    """alpha2 / d of the paper's section 3.3, averaged over the horizon.

    d is the smallest gap between the end caps and the obstacles but ramps, in robot lengths.
    """

    weight: float

    def __call__(self, points: Floats, task: Task) -> Floats:
        """Cost (B,) of points (B, H + 1, P, 3)."""
        walls = tuple(box for box in task.obstacles if not box.tilted)
        gaps = gap(points, task.robot, walls) / task.robot.length
        return self.weight * (1.0 / np.maximum(gaps, NEAREST)).mean(axis=1)


def gap(points: Floats, robot: Robot, boxes: tuple[Box, ...]) -> Floats:
    """Smallest distance (...) between the caps' surfaces and boxes, for points (..., P, 3) [m].

    Infinite without boxes; at least minus a cap's radius, where its centre touches a box.
    """
    radii = np.array([point.radius for point in robot.points])
    nearest = np.full(points.shape[:-2], np.inf)
    for box in boxes:
        distances = np.linalg.norm(np.maximum(box.beyond(points), 0.0), axis=-1) - radii
        nearest = np.minimum(nearest, distances.min(axis=-1))
    return nearest
