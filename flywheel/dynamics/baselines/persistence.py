"""The dynamics model that predicts no motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.dynamics.baselines.inputs import check_shapes, without_gaps
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
        check_shapes(self.robot, past, controls)
        batch, horizon, winches = controls.shape
        points = without_gaps(past.observations.points)[:, -1:]
        start = np.broadcast_to(past.winch[:, -1], (batch, winches))
        winch = self.robot.dead_reckon(start, controls, self.dt)
        return Rollout(
            np.broadcast_to(points, (batch, horizon + 1, *points.shape[2:])).copy(), winch
        )
