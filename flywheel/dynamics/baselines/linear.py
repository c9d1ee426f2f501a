"""A linear autoregressive model with the winches as inputs (ARX)."""

from __future__ import annotations

from itertools import combinations
from typing import Annotated, ClassVar, Self

import numpy as np

from flywheel.dynamics.baselines.inputs import check_shapes, without_gaps
from flywheel.errors import ModelError
from flywheel.quantities import Bounds
from flywheel.records import Floats, Past, Rollout
from flywheel.robots import Robot
from flywheel.validation import Frozen

_FAR = 1e6  # [robot's lengths] from the present where a prediction counts as diverged
_STANDING = 1e-3  # horizontal share of the robot's length below which there is no heading


class LinearConfig(Frozen):
    """Inputs of a `LinearDynamics`.

    Attributes:
      pose_lags: past steps of the points.
      input_lags: steps of the commands, the coming one among them.
    """

    pose_lags: Annotated[int, Bounds(1, 200, "steps")] = 8
    input_lags: Annotated[int, Bounds(1, 500, "steps")] = 30


class LinearDynamics:
    """The points' next step as a linear function of their last steps, the winches and their commands.

    A robot that is not tied to the world is seen from where it is, in axes that turn with its heading, so
    predictions do not depend on place and direction. Bodies are not kept rigid.

    Args:
      robot: the robot.
      dt: control step [s].
      config: its inputs.
      coefficients: (inputs, 3 P) from inputs to displacements in one step [robot's lengths]; None predicts
        no motion.
    """

    kind: ClassVar[str] = "arx"
    Config: ClassVar[type[LinearConfig]] = LinearConfig

    def __init__(
        self,
        robot: Robot,
        dt: float,
        config: LinearConfig = LinearConfig(),
        coefficients: Floats | None = None,
    ) -> None:
        self.robot, self.dt, self.config = robot, dt, config
        shape = self.shapes(robot, config)["coefficients"]
        self.coefficients = np.zeros(shape) if coefficients is None else np.asarray(coefficients)
        self._heading = _far_apart(robot)

    @classmethod
    def shapes(cls, robot: Robot, config: LinearConfig) -> dict[str, tuple[int, ...]]:
        """Shapes of the arrays of such a model, by name."""
        outputs, winches = 3 * len(robot.points), len(robot.winches)
        inputs = (config.pose_lags + 1) * outputs + (config.input_lags + 1) * winches + 1
        return {"coefficients": (inputs, outputs)}

    @property
    def arrays(self) -> dict[str, Floats]:
        """Its fitted numbers, by name."""
        return {"coefficients": self.coefficients}

    @classmethod
    def of(cls, robot: Robot, dt: float, config: LinearConfig, arrays: dict[str, Floats]) -> Self:
        """The model with given `arrays`."""
        return cls(robot, dt, config, arrays["coefficients"])

    @property
    def history(self) -> int:
        return max(self.config.pose_lags, self.config.input_lags - 1)

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls` (B, H, W).

        Raises:
          ModelError: shapes do not fit, a point is missing in the whole past, or the prediction
            diverges.
        """
        robot, lags = self.robot, self.config.pose_lags
        check_shapes(robot, past, controls)
        past = past.latest(self.history, robot.holding(past.winch[:, 0]))
        batch, horizon, winches = controls.shape
        seen = without_gaps(past.observations.points)[:, -lags - 1 :]
        winch = robot.dead_reckon(
            np.broadcast_to(past.winch[:, -1], (batch, winches)), controls, self.dt
        )
        before = np.broadcast_to(past.controls, (batch, *past.controls.shape[1:]))
        told = np.concatenate([before, controls], axis=1)
        first = past.history - self.config.input_lags + 1
        points = list(np.broadcast_to(seen, (batch, *seen.shape[1:])).swapaxes(0, 1))
        for t in range(horizon):
            recent = np.stack(points[-lags - 1 :], axis=1)
            commands = told[:, first + t : first + t + self.config.input_lags]
            inputs, turn = self.inputs(recent, winch[:, t], commands)
            step = (inputs @ self.coefficients).reshape(batch, -1, 3) * robot.length
            points.append(points[-1] + step @ turn)
            if not np.abs(points[-1] - points[lags]).max() < _FAR * robot.length:
                raise ModelError(
                    f"The linear model diverges: it is {_FAR:g} times the robot's length away, or "
                    f"not finite, after {(t + 1) * self.dt:g} s."
                )
        return Rollout(np.stack(points[lags:], axis=1), winch)

    def inputs(self, points: Floats, winch: Floats, commands: Floats) -> tuple[Floats, Floats]:
        """Inputs (B, inputs) of one step, and the axes (B, 3, 3) they are in; all of order 1.

        Args:
          points: (B, pose_lags + 1, P, 3), the present last [m].
          winch: (B, W) at the present [m].
          commands: (B, input_lags, W), the coming one last.
        """
        robot, batch = self.robot, len(points)
        turn, present = self.axes(points[:, -1]), points[:, -1]
        origin = np.zeros((batch, 1, 3))
        if not robot.tethered:
            origin[..., :2] = present[..., :2].mean(axis=1, keepdims=True)
        steps = np.diff(points, axis=1) @ turn[:, None].swapaxes(-1, -2)
        place = (present - origin) @ turn.swapaxes(-1, -2)
        half = (robot.control_high - robot.control_low) / 2.0
        told = (np.clip(commands, robot.control_low, robot.control_high) - robot.control_low) / half
        parts = (steps / robot.length, place / robot.length, winch / robot.length, told - 1.0)
        flat = [part.reshape(batch, -1) for part in parts]
        return np.concatenate([*flat, np.ones((batch, 1))], axis=1), turn

    def axes(self, present: Floats) -> Floats:
        """(B, 3, 3) axes of the heading at points (B, P, 3) [m]; rows are unit vectors in the world."""
        axes = np.tile(np.eye(3), (len(present), 1, 1))
        if self.robot.tethered:
            return axes
        first, second = self._heading
        way = present[:, second, :2] - present[:, first, :2]
        size = np.linalg.norm(way, axis=1, keepdims=True)
        lies = size > _STANDING * self.robot.length
        east = np.where(lies, way / np.where(lies, size, 1.0), [1.0, 0.0])
        axes[:, 0, :2] = east
        axes[:, 1, :2] = east[:, ::-1] * [-1.0, 1.0]
        return axes


def _far_apart(robot: Robot) -> tuple[int, int]:
    """The two tracked points of one body that are farthest apart; else the first and the last point."""
    pairs = [pair for body in robot.bodies for pair in combinations(body.points, 2)]

    def apart(pair: tuple[int, int]) -> float:
        a, b = (robot.points[i].offset for i in pair)
        return float(np.linalg.norm(b - a))

    return max(pairs, key=apart, default=(0, len(robot.points) - 1))
