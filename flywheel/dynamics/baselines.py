"""Trivial dynamics models, as baselines for all others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.errors import ModelError
from flywheel.records import Floats, Past, Rollout
from flywheel.robots import Robot


@dataclass(frozen=True)
class Persistence:
    """No motion: the last seen points are repeated; the winches follow their commands.

    A point missing at the present stays at its last known position within the past.

    Attributes:
      robot: the robot it predicts.
      dt: control step [s].
      history: past steps searched for a missing point.
    """

    robot: Robot
    dt: float
    history: int = 20

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls` (B, H, W).

        Raises:
          ModelError: the shapes do not fit the robot, or a point is missing in the whole past.
        """
        batch, horizon, winches = controls.shape
        if winches != len(self.robot.winches):
            raise ModelError(
                f"Robot {self.robot.name} has {len(self.robot.winches)} winches, got controls for "
                f"{winches}."
            )
        seen = past.observations.points
        points = seen[:, -1].copy()
        for step in range(2, seen.shape[1] + 1):
            points = np.where(np.isfinite(points), points, seen[:, -step])
        if not np.isfinite(points).all():
            raise ModelError(
                "A tracked point was not seen in the whole past; there is no position to repeat."
            )
        points = np.broadcast_to(points[:, None], (len(points), horizon + 1, *points.shape[1:]))
        start = np.broadcast_to(past.winch[:, -1], (batch, winches))
        winch = self.robot.dead_reckon(start, controls, self.dt)
        return Rollout(np.broadcast_to(points, (batch, *points.shape[1:])).copy(), winch)
