"""Trained networks shipped with Flywheel, each with a card: its training and its errors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from flywheel.dynamics.gnn.weights import read_about
from flywheel.errors import WeightsError
from flywheel.files import read_yaml
from flywheel.quantities import (
    Bounds,
    Episodes,
    EpisodeSeconds,
    HorizonSeconds,
    Name,
    OptimiserSteps,
    Samples,
    Seed,
    Share,
)
from flywheel.robots import Robot
from flywheel.validation import Frozen, validated

SHIPPED = "shipped"  # where a model is named: the network that comes with Flywheel for the robot
MOST_ERRORS = 1000  # of a card
MJCF, NETWORK = "the MJCF's", "network"  # names of plants and of a model in a card
FOLDER = Path(__file__).parent / "networks"


class PredictionError(Frozen):
    """The errors of a model over a horizon, on plants of one group.

    Attributes:
      plants: `MJCF`, or the name of the group.
      model: `NETWORK`, or a model for comparison.
      e_pos: RMSE of the centres of mass [% of the robot's length].
      e_rot: mean angle between predicted and true bodies [deg].
    """

    plants: Name
    model: Name
    e_pos: Annotated[float, Bounds(0, 1e6, "%")]
    e_rot: Annotated[float, Bounds(0, 180, "deg")]


class ModelCard(Frozen):
    """Description of a shipped network.

    Attributes:
      robot: its name.
      digest: of the weights.
      configuration: of the training run.
      seed: of that run.
      code: version of Flywheel in that run.
      plants: used for training.
      minutes: of simulated motion in training [min].
      steps: of the optimiser.
      noise: of the points, in training and here [fraction of the robot's length].
      horizon: of the errors [s].
      episodes: with random controls for each plant; each lasts `seconds`, and there are `starts`
        predictions.
      seconds, starts: see `episodes`.
      errors: on episodes not used for training.
    """

    robot: Name
    digest: Name
    configuration: Name
    seed: Seed
    code: Name
    plants: Samples
    minutes: Annotated[float, Bounds(0, 1e9, "min")]
    steps: OptimiserSteps
    noise: Share
    horizon: HorizonSeconds
    episodes: Episodes
    seconds: EpisodeSeconds
    starts: Samples
    errors: Annotated[tuple[PredictionError, ...], Field(max_length=MOST_ERRORS)]

    def __str__(self) -> str:
        of = {error.model: error for error in self.errors if error.plants == MJCF}
        return (
            f"Trained on {self.minutes:.0f} min of {self.plants} plants; over {self.horizon:g} s e_pos "
            f"{of[NETWORK].e_pos:.1f} %, e_rot {of[NETWORK].e_rot:.1f} deg."
        )

    @classmethod
    def read(cls, weights: Path) -> ModelCard:
        """The card next to a file of weights.

        Raises:
          WeightsError: it is missing or malformed.
        """
        path = weights.with_suffix(".yaml")
        values = read_yaml(path, "model card", WeightsError)
        return validated(cls, values, f"{path} is not a model card", WeightsError)


def shipped_networks() -> Mapping[str, Path]:
    """Robot's name -> weights, for all shipped networks."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.npz"))}


def shipped_weights(robot: Robot) -> Path:
    """The weights of the shipped network for a robot.

    Raises:
      WeightsError: there is none for it.
    """
    networks = shipped_networks()
    for path in networks.values():
        if read_about(path)["robot"] == robot.digest:
            return path
    raise WeightsError(
        f"No network for {robot.name} ({robot.digest[:12]}) comes with Flywheel, only for the shipped robots "
        f"{', '.join(networks)}. Train one: `flywheel run prism3 model=MY_ROBOT.xml iterations=0`."
    )
