"""A learned dynamics model as a self-contained folder, and as a "pyfunc" for MLflow.

MLflow calls `_load_pyfunc` with the folder, and `predict` with arrays. Nothing is pickled, and mlflow is not
imported here.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.dynamics.gnn import ChunkNetwork, LearnedDynamics, load_weights, save_weights
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import DataError
from flywheel.records import Floats, Observation, Past
from flywheel.robots import Robot, read_robot

ROBOT = "robot.xml"
WEIGHTS = "weights.npz"
Shapes = dict[str, tuple[int, ...]]


def signature(points: int, winches: int) -> tuple[Shapes, Shapes]:
    """Shapes of the inputs and outputs of `PyfuncDynamics.predict`; -1 stands for any length.

    Args:
      points: P, tracked points of the robot.
      winches: W, winches of the robot.
    """
    inputs = {
        "points": (-1, -1, points, 3),
        "winch": (-1, -1, winches),
        "past_controls": (-1, -1, winches),
        "controls": (-1, -1, winches),
    }
    return inputs, {"points": (-1, -1, points, 3), "winch": (-1, -1, winches)}


class PyfuncDynamics:
    """A dynamics model with plain arrays as input and output.

    Args:
      dynamics: the model.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics

    def predict(
        self, model_input: Mapping[str, Floats], params: dict[str, Any] | None = None
    ) -> dict[str, Floats]:
        """Predict the tracked points under future controls.

        Args:
          model_input: "points" (B, h + 1, P, 3) measured, oldest first [m]; "winch" (B, h + 1, W),
            best estimate of the winch positions [m]; "past_controls" (B, h, W), the commands
            between them; "controls" (B, H, W), future ones.
          params: MLflow's parameters; not used.

        Returns:
          "points" (B, H + 1, P, 3) [m] and "winch" (B, H + 1, W) [m]; entry 0 is the present.

        Raises:
          DataError: an array is missing.
        """
        del params
        robot = self.dynamics.robot
        wanted, _ = signature(len(robot.points), len(robot.winches))
        if missing := sorted(set(wanted) - set(model_input)):
            raise DataError(f"The model wants the arrays {', '.join(wanted)}; missing: {missing}.")
        arrays = {name: np.asarray(model_input[name], np.float64) for name in wanted}
        past = Past(
            Observation(arrays["points"], arrays["winch"]), arrays["past_controls"], arrays["winch"]
        )
        rollout = self.dynamics.rollout(past, arrays["controls"])
        return {"points": np.asarray(rollout.points), "winch": np.asarray(rollout.winch)}


def write_model(folder: Path, robot: Robot, network: ChunkNetwork, snapshot: str = "") -> str:
    """Write a self-contained model into a folder; return the digest of the weights.

    Args:
      folder: made if it is missing.
      robot: of the network.
      network: with its weights.
      snapshot: digest of the training data.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ROBOT).write_text(robot.xml)
    return save_weights(network, folder / WEIGHTS, snapshot)


def read_model(folder: Path) -> LearnedDynamics:
    """The dynamics model from a folder of `write_model`.

    Raises:
      ModelError: the weights are missing, damaged, or for another robot.
    """
    robot = read_robot(folder / ROBOT)
    return LearnedDynamics(robot, load_weights(folder / WEIGHTS, robot))


def _load_pyfunc(path: str) -> PyfuncDynamics:
    """Called by MLflow."""
    return PyfuncDynamics(read_model(Path(path)))
