"""A learned dynamics model as one self-contained folder, and as the object that MLflow serves.

MLflow calls `_load_pyfunc` with the folder and then `predict`
with arrays. No pickle, no MLflow here.
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
    """Shapes of what `ServedDynamics.predict` takes and gives; -1 is any length (B, time, batch).

    Args:
      points: P, tracked points of the robot.
      winches: W.
    """
    inputs = {
        "points": (-1, -1, points, 3),
        "winch": (-1, -1, winches),
        "past_controls": (-1, -1, winches),
        "controls": (-1, -1, winches),
    }
    return inputs, {"points": (-1, -1, points, 3), "winch": (-1, -1, winches)}


class ServedDynamics:
    """A dynamics model behind plain arrays.

    Args:
      dynamics: to serve.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self.dynamics = dynamics

    def predict(
        self, model_input: Mapping[str, Floats], params: dict[str, Any] | None = None
    ) -> dict[str, Floats]:
        """Predict the tracked points under future controls.

        Args:
          model_input: "points" (B, h + 1, P, 3) measured, oldest first [m]; "winch" (B, h + 1, W),
            best knowledge of the winch positions [m]; "past_controls" (B, h, W), the commands
            between them; "controls" (B, H, W), those to come.
          params: none are known.

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


def write_served(folder: Path, robot: Robot, network: ChunkNetwork, snapshot: str = "") -> str:
    """Write everything that the model needs into `folder`; return the digest of the weights.

    Args:
      folder: made if need be.
      robot: that the network was trained on.
      network: its weights.
      snapshot: digest of the data they were trained on.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ROBOT).write_text(robot.xml)
    return save_weights(network, folder / WEIGHTS, snapshot)


def read_served(folder: Path) -> LearnedDynamics:
    """The dynamics model that `write_served` wrote.

    Raises:
      ModelError: the weights are missing, damaged, or for another robot.
    """
    robot = read_robot(folder / ROBOT)
    return LearnedDynamics(robot, load_weights(folder / WEIGHTS, robot))


def _load_pyfunc(path: str) -> ServedDynamics:
    """Called by MLflow."""
    return ServedDynamics(read_served(Path(path)))
