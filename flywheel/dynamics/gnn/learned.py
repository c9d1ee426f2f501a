"""A trained network as a dynamics model."""

from __future__ import annotations

from typing import Literal

from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.records import Floats, Past, Rollout
from flywheel.robots import Robot


class LearnedDynamics:
    """Predicts with a network; answers `flywheel.dynamics.protocol.Dynamics`.

    Args:
      robot: the robot.
      network: its weights; they are copied, later changes have no effect.
      threads: Python threads that share the batch, block by block.
      block: candidates computed at a time.
      precision: of the latents.
    """

    def __init__(
        self,
        robot: Robot,
        network: ChunkNetwork,
        threads: int = 1,
        block: int = 64,
        precision: Literal["float32", "bfloat16"] = "float32",
    ) -> None:
        self.robot, self.dt, self.history = robot, network.config.dt, network.config.history
        self.digest = ""

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls` (B, H, W).

        Raises:
          ModelError: shapes do not fit the robot, or the prediction is not finite.
        """
        raise NotImplementedError
