"""From a measured past and controls to predicted points, differentiable through all chunks."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.robots import Robot


@dataclass(frozen=True)
class Unrolled:
    """A prediction of T control steps.

    Attributes:
      points: (B, T, P, 3) tracked points, each body rigid [m].
      node_positions: (B, T, N, 3) body nodes, each body rigid [m].
      velocities: (B, T, N, 3) body nodes' velocities as predicted, before the rigid fit [m/s].
      winch: (B, T, W) winch positions [m].
    """

    points: Tensor
    node_positions: Tensor
    velocities: Tensor
    winch: Tensor


class Simulator:
    """Runs a network on a robot.

    Args:
      robot: the robot.
      config: the network's.
    """

    def __init__(self, robot: Robot, config: NetworkConfig) -> None:
        self.robot, self.config, self.dt = robot, config, config.dt

    def node_positions(self, points: Tensor) -> Tensor:
        """Where the N body nodes are, (..., N, 3), if the tracked points are at (..., P, 3)."""
        raise NotImplementedError

    def unroll(
        self,
        network: ChunkNetwork,
        past_points: Tensor,
        past_controls: Tensor,
        past_winch: Tensor,
        controls: Tensor,
        dataset: Tensor,
    ) -> Unrolled:
        """Predict T steps from the present, the past's last entry. h is `config.history`.

        Args:
          network: the weights.
          past_points: (B, h + 1, P, 3) measured points [m]; NaN where missing.
          past_controls: (B, h, W) commands between them.
          past_winch: (B, h + 1, W) winch positions [m]; NaN where unknown.
          controls: (B, T, W) commands to come; T need not be a multiple of the chunk.
          dataset: (B,) int64 index of the data set.
        """
        raise NotImplementedError
