"""Inputs that the baselines share: checked shapes, and pasts without gaps."""

from __future__ import annotations

import numpy as np

from flywheel.errors import ModelError
from flywheel.records import Floats, Past
from flywheel.robots import Robot


def check_shapes(robot: Robot, past: Past, controls: Floats) -> None:
    """Check a question to a dynamics model.

    Raises:
      ModelError: shapes do not fit the robot, or each other.
    """
    winches, batch = len(robot.winches), len(past.observations.points)
    if controls.ndim != 3 or controls.shape[2] != winches or not controls.shape[1]:
        raise ModelError(
            f"Controls must have shape (batch, steps, {winches}), as robot {robot.name} has {winches} "
            f"winches; got {controls.shape}."
        )
    if batch not in (1, len(controls)):
        raise ModelError(
            f"The past must have batch size 1 or that of the controls, {len(controls)}; got {batch}."
        )


def without_gaps(points: Floats) -> Floats:
    """Points (B, h + 1, P, 3); one that is missing stays where it was, at first where it will be [m].

    Raises:
      ModelError: a point is missing in the whole past.
    """
    points = points.copy()
    for steps in (range(1, points.shape[1]), range(points.shape[1] - 2, -1, -1)):
        back = -1 if steps.step > 0 else 1
        for step in steps:
            missing = ~np.isfinite(points[:, step])
            points[:, step][missing] = points[:, step + back][missing]
    if not np.isfinite(points).all():
        raise ModelError(
            "A tracked point was not seen in the whole past; there is no position to go on from."
        )
    return points
