"""A model's files as arrays, so that they go to every worker once, through shared memory."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flywheel.dynamics.gnn import LearnedDynamics, load_weights
from flywheel.robots import Robot


@dataclass(frozen=True)
class Weights:
    """Weights on their way to a worker.

    Attributes:
      digest: of the weights; which model this is.
      files: contents of each file by its suffix, as uint8.
    """

    digest: str
    files: dict[str, NDArray[np.uint8]]

    @classmethod
    def read(cls, path: Path, digest: str) -> Weights:
        """Read the files that `save_weights` wrote for `path`."""
        files = {p.suffix: np.fromfile(p, np.uint8) for p in path.parent.glob(f"{path.stem}.*")}
        return cls(digest, files)

    def dynamics(self, robot: Robot, threads: int = 1) -> LearnedDynamics:
        """The model itself.

        Raises:
          ModelError: the files are damaged, or for another robot.
        """
        with tempfile.TemporaryDirectory() as folder:
            for suffix, content in self.files.items():
                content.tofile(Path(folder) / f"weights{suffix}")
            network = load_weights(Path(folder) / "weights.npz", robot)
        return LearnedDynamics(robot, network, threads=threads)
