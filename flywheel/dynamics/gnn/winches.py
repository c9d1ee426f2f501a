"""The robot's nominal winches in torch, and the limits of winch positions."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from flywheel.robots import Robot


class Winches:
    """Winch arithmetic of one robot; arrays are (..., W, K).

    Args:
      robot: the robot.
      dt: control step [s].
      device: where its tensors are.
    """

    def __init__(self, robot: Robot, dt: float, device: torch.device) -> None:
        def column(values: np.ndarray) -> Tensor:
            return torch.as_tensor(values, dtype=torch.float32, device=device)[:, None]

        lag = np.array([w.time_constant for w in robot.winches])
        rate = np.asarray(robot.rate_driven)
        # position' = keep position + gain command, where keep is 1 for a rate winch
        self.gain = column(np.where(rate, dt, -np.expm1(-dt / np.maximum(lag, 1e-9))))
        self.keep = None if rate.all() else torch.where(column(rate) > 0, 1.0, 1.0 - self.gain)
        self._rate = torch.as_tensor(rate, device=device)[:, None]
        self._low, self._high = column(robot.control_low), column(robot.control_high)
        self.rest_low, self.rest_high = column(robot.rest_low), column(robot.rest_high)
        middle = np.where(rate, 0.0, (robot.control_high + robot.control_low) / 2)
        reach = np.maximum(robot.control_high - middle, middle - robot.control_low)
        self._middle, self._reach = column(middle), column(np.maximum(reach, 1e-9))
        self.start = column(
            np.array([robot.cables[w.cables[0]].rest_length for w in robot.winches])
        )

    def clipped(self, controls: Tensor) -> Tensor:
        """Commands within the winches' range, (..., W, K)."""
        return torch.clamp(controls, self._low, self._high)

    def scaled(self, controls: Tensor) -> Tensor:
        """Commands in units of their range, within [-1, 1]."""
        return (controls - self._middle) / self._reach

    def within(self, positions: Tensor) -> Tensor:
        """Positions within the winches' range."""
        return torch.clamp(positions, self.rest_low, self.rest_high)

    def held(self, last: Tensor, steps: int) -> Tensor:
        """(steps, W, K) commands that hold winches whose last commands (W, K) were `last`."""
        return torch.where(self._rate, torch.zeros_like(last), last).expand(steps, -1, -1)

    def nominal(self, position: Tensor, controls: Tensor) -> Tensor:
        """Motion of nominal winches: (T, W, K) positions after each of the commands (T, W, K).

        The same as `Robot.dead_reckon`.
        """
        positions = []
        for step in (self.gain * controls).unbind():
            kept = position if self.keep is None else self.keep * position
            position = self.within(kept + step)
            positions.append(position)
        return torch.stack(positions)

    def present(self, past: Tensor, controls: Tensor) -> Tensor:
        """(W, K) best estimate of the present positions.

        Args:
          past: (h + 1, W, K) positions; NaN where unknown. Before the first known one, the winches
            are assumed at their positions in the robot's keyframe.
          controls: (h, W, K) commands between them.
        """
        if bool(torch.isfinite(past[-1]).all()):
            return past[-1]
        position = torch.where(torch.isfinite(past[0]), past[0], self.start.expand_as(past[0]))
        for t in range(len(controls)):
            position = self.nominal(position, controls[t : t + 1])[0]
            position = torch.where(torch.isfinite(past[t + 1]), past[t + 1], position)
        return position
