"""Plans as rest lengths at knots in time, and the commands that follow them.

Rest lengths are a better search space than rates: noise on a rate is a random walk of the rest
length, which soon reaches a limit of its range; noise on a knot is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot


@dataclass(frozen=True)
class Knots:
    """Grid of knots for the plans of one robot.

    A plan is (..., S, W): the desired winch positions at the ends of S spans of `steps` control
    steps each. Between knots they are interpolated linearly.

    Attributes:
      robot: commanded robot.
      dt: control step [s].
      steps: control steps between knots.
      count: S.
    """

    robot: Robot
    dt: float
    steps: int
    count: int

    def reachable(self, winch: Floats, plan: Floats) -> Floats:
        """The plan (..., S, W) that winches starting at `winch` (..., W) can follow.

        Positions are clipped to the range, and changes between knots to the fastest rate; a winch
        that cannot keep up continues towards the following knots.
        """
        robot, span = self.robot, self.steps * self.dt
        unbounded = np.full(len(robot.winches), np.inf)
        slowest = np.where(robot.rate_driven, robot.control_low * span, -unbounded)
        fastest = np.where(robot.rate_driven, robot.control_high * span, unbounded)
        positions = []
        now = np.broadcast_to(winch, plan[..., 0, :].shape)
        for knot in range(self.count):
            wanted = np.clip(plan[..., knot, :], robot.rest_low, robot.rest_high)
            now = now + np.clip(wanted - now, slowest, fastest)
            positions.append(now)
        return np.stack(positions, axis=-2)

    def controls(self, winch: Floats, plan: Floats) -> Floats:
        """Commands (..., S * steps, W) that follow a plan (..., S, W) from `winch` (..., W)."""
        robot = self.robot
        after = self.reachable(winch, plan)
        first = np.broadcast_to(np.asarray(winch)[..., None, :], after[..., :1, :].shape)
        before = np.concatenate([first, after[..., :-1, :]], axis=-2)
        share = np.arange(1, self.steps + 1)[:, None] / self.steps
        change = (after - before)[..., None, :]
        rates = np.broadcast_to(
            change / (self.steps * self.dt),
            (*change.shape[:-2], *share.shape[:1], change.shape[-1]),
        )
        positions = before[..., None, :] + share * change
        commands = np.where(robot.rate_driven, rates, positions)
        commands = np.clip(commands, robot.control_low, robot.control_high)
        return commands.reshape(*commands.shape[:-3], self.count * self.steps, -1)

    def later(self, plan: Floats, steps: int) -> Floats:
        """The rest of a plan (..., S, W) after `steps` control steps; its last knot is repeated."""
        at = (np.arange(self.count) + steps / self.steps).clip(max=self.count - 1)
        low = at.astype(int)
        high = np.minimum(low + 1, self.count - 1)
        share = (at - low)[:, None]
        return (1 - share) * plan[..., low, :] + share * plan[..., high, :]
