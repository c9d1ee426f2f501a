"""A model's weights on their way to the workers: once, as numpy, through shared memory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flywheel.dynamics.gnn import LearnedDynamics, NetworkConfig, load_weights
from flywheel.dynamics.gnn.weights import (
    network_from_arrays,
    weights_arrays,
    weights_digest,
)
from flywheel.robots import Robot


@dataclass(frozen=True)
class Weights:
    """Weights as arrays.

    Attributes:
      digest: which model this is.
      config: of its network.
      arrays: by name.
    """

    digest: str
    config: NetworkConfig
    arrays: dict[str, np.ndarray]

    @classmethod
    def read(cls, path: Path, robot: Robot) -> Weights:
        """Read the file that `save_weights` wrote.

        Raises:
          ModelError: it is missing, damaged, or for another robot.
        """
        network = load_weights(path, robot)
        return cls(weights_digest(network), network.config, weights_arrays(network))

    def dynamics(self, robot: Robot, threads: int = 1) -> LearnedDynamics:
        """The model itself."""
        network = network_from_arrays(robot, self.config, self.arrays)
        return LearnedDynamics(robot, network, threads=threads)
