"""Errors: statistics aggregated over samples, by lead time and body, as sums that add."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flywheel.errors import DataError, ModelError
from flywheel.evaluation.statistics import (
    rotation_error,
    squared_point_error,
    squared_position_error,
)
from flywheel.evaluation.sums import ExactSum
from flywheel.records import Floats
from flywheel.robots import Robot


@dataclass(frozen=True)
class ErrorTable:
    """A dynamics model's errors over a set of windows. Tables of one robot add, exactly.

    **Definitions** (L is the robot's characteristic length, means run over windows, lead times and
    bodies): `e_pos_mse` = mean |dP|^2 / L with |dP|^2 summed over x, y, z, as the paper writes it:
    it has the unit of a length and is shown times 100. `e_pos_rmse` = sqrt(mean |dP|^2) / L [%].
    `e_rot` = mean angle between body axes (or orientations) [deg].

    Attributes:
      length: L [m].
      dt: between lead times [s].
      bodies: names of the bodies.
      position: (T, bodies) sums of squared CoM errors [m^2].
      rotation: (T, bodies) sums of angles [deg].
      point: (T, P) sums of squared errors of the tracked points [m^2].
      windows: how many windows were scored.
    """

    length: float
    dt: float
    bodies: tuple[str, ...]
    position: ExactSum
    rotation: ExactSum
    point: ExactSum
    windows: int = 0

    @classmethod
    def empty(cls, robot: Robot, dt: float) -> ErrorTable:
        """The table without windows, neutral for addition."""
        bodies = tuple(body.name for body in robot.bodies)
        by_body, by_point = (0, len(bodies)), (0, len(robot.points))
        sums = (ExactSum.zeros(by_body), ExactSum.zeros(by_body), ExactSum.zeros(by_point))
        return cls(robot.length, dt, bodies, *sums)

    @classmethod
    def between(cls, robot: Robot, dt: float, truth: Floats, predicted: Floats) -> ErrorTable:
        """Score predicted against true points.

        Args:
          truth: (B, T, P, 3) at lead times 1..T [m]; NaN where missing or past a window's end.
          predicted: (B, T, P, 3) [m], finite.

        Raises:
          DataError: the shapes differ.
          ModelError: a prediction is not finite.
        """
        if truth.shape != predicted.shape:
            raise DataError(
                f"Predicted points have shape {predicted.shape}, the true ones {truth.shape}."
            )
        if not np.isfinite(predicted).all():
            raise ModelError("A prediction is not finite; it cannot be scored.")
        return cls(
            robot.length,
            dt,
            tuple(body.name for body in robot.bodies),
            ExactSum.of(squared_position_error(robot, truth, predicted)),
            ExactSum.of(rotation_error(robot, truth, predicted)),
            ExactSum.of(squared_point_error(robot, truth, predicted)),
            windows=truth.shape[0],
        )

    def __add__(self, other: ErrorTable) -> ErrorTable:
        mine = (self.length, self.dt, self.bodies)
        theirs = (other.length, other.dt, other.bodies)
        if mine != theirs:
            raise DataError(f"Errors of different robots or times do not add: {mine} and {theirs}.")
        return replace(
            self,
            position=self.position + other.position,
            rotation=self.rotation + other.rotation,
            point=self.point + other.point,
            windows=self.windows + other.windows,
        )

    @property
    def steps(self) -> int:
        """T, the number of lead times."""
        return self.position.shape[0]

    @property
    def e_pos_mse(self) -> float:
        """Mean squared CoM error / L [%, of a length]; NaN without a sample."""
        return float(100.0 * self.position.over((0, 1)).mean / self.length)

    @property
    def e_pos_rmse(self) -> float:
        """Root of the mean squared CoM error / L [%]; NaN without a sample."""
        return float(100.0 * np.sqrt(self.position.over((0, 1)).mean) / self.length)

    @property
    def e_rot(self) -> float:
        """Mean rotation error [deg]; NaN without a sample."""
        return float(self.rotation.over((0, 1)).mean)

    def by_lead_time(self) -> dict[str, Floats]:
        """Errors at each lead time, averaged over bodies and windows; all (T,).

        They are `seconds` [s], `e_pos_mse` and `e_pos_rmse` [%], and `e_rot` [deg].
        """
        squared = self.position.over(1).mean
        return {
            "seconds": np.arange(1, self.steps + 1) * self.dt,
            "e_pos_mse": 100.0 * squared / self.length,
            "e_pos_rmse": 100.0 * np.sqrt(squared) / self.length,
            "e_rot": self.rotation.over(1).mean,
        }
