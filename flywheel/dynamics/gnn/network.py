"""The network's weights: one set, which the fused and the plain forward pass both read."""

from __future__ import annotations

from torch import nn

from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.robots import Robot


class ChunkNetwork(nn.Module):
    """The weights of one network for one robot.

    Args:
      robot: whose graph it works on.
      config: its shape.
    """

    def __init__(self, robot: Robot, config: NetworkConfig) -> None:
        super().__init__()
        self.robot_digest, self.config = robot.digest, config
