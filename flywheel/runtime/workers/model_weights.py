"""A trained model in transit to the workers: its weights as numpy arrays, through shared memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flywheel.diagnosis.fitting.subject import Subject
from flywheel.dynamics.arithmetic import Arithmetic
from flywheel.dynamics.baselines.weights import BaselineWeights, is_baseline
from flywheel.dynamics.gnn import LearnedDynamics, NetworkConfig, load_weights
from flywheel.dynamics.gnn.weights import network_from_arrays, weights_digest
from flywheel.dynamics.residual import ResidualWeights, is_residual
from flywheel.dynamics.weight_files import arrays_of
from flywheel.effects import NAMED, Effect
from flywheel.errors import ModelError
from flywheel.robots import Robot
from flywheel.runtime.workers.episode_plan import Effects


@dataclass(frozen=True)
class Weights:
    """A network's weights as arrays.

    Attributes:
      digest: of the weights.
      config: of the network.
      arrays: by name.
    """

    digest: str
    config: NetworkConfig
    arrays: dict[str, np.ndarray]

    @classmethod
    def read(cls, path: Path, robot: Robot, digest: str = "") -> Weights:
        """Read a file of `save_weights`.

        Args:
          path: of the file.
          robot: of the weights.
          digest: required one; "" for any.

        Raises:
          ModelError: the file is missing, damaged, for another robot, or has other weights.
        """
        network = load_weights(path, robot)
        found = weights_digest(network)
        if digest not in ("", found):
            raise ModelError(
                f"The weights {path} are not those that were trained here: their digest is "
                f"{found[:12]}, not {digest[:12]}. `flywheel data verify RUN` says which they are."
            )
        return cls(found, network.config, arrays_of(network))

    def dynamics(
        self,
        robot: Robot,
        threads: int = 1,
        library: Mapping[str, Effect] = NAMED,
        arithmetic: Arithmetic = Arithmetic(),
    ) -> LearnedDynamics:
        """The dynamics model with these weights, which needs no library of effects.

        Raises:
          ConfigError: there is no such device.
        """
        network = network_from_arrays(robot, self.config, self.arrays)
        return LearnedDynamics(robot, network, threads, **vars(arithmetic))


AnyWeights = Weights | ResidualWeights | BaselineWeights
"""Weights of a network or a corrected plant, or the numbers of a fitted baseline."""


def read_weights(
    path: Path, robot: Robot, digest: str = "", library: Mapping[str, Effect] = NAMED
) -> AnyWeights:
    """Read a file of any kind.

    Args:
      path: of the file.
      robot: of the weights.
      digest: required one of a network; "" for any.
      library: of a corrected plant's effects.

    Raises:
      ModelError: the file is missing or damaged, or for another robot.
    """
    if is_residual(path):
        return ResidualWeights.read(path, robot, library=library)
    if is_baseline(path):
        return BaselineWeights.read(path, robot)
    return Weights.read(path, robot, digest)


@dataclass(frozen=True)
class TrainedModel:
    """A trained model under test in a diagnosis or comparison.

    Attributes:
      name: for people.
      weights: of the network or the corrected plant, or of the baseline.
      dataset: index of the data set for recordings.
      effects: known effects of the robot during training.
      library: of these.
    """

    name: str
    weights: AnyWeights
    dataset: int = 0
    effects: Effects = ()
    library: Mapping[str, Effect] = field(default_factory=lambda: NAMED)

    @classmethod
    def read(cls, name: str, path: Path, robot: Robot) -> TrainedModel:
        """A file of weights.

        Raises:
          ModelError: the file is missing or damaged, or for another robot.
        """
        found = read_weights(path, robot)
        own = found.corrected.effects if isinstance(found, ResidualWeights) else ()
        return cls(name, found, effects=own)

    def subject(self, robot: Robot, threads: int = 1) -> Subject:
        """The model as a subject of a diagnosis or comparison."""
        terms = tuple(effect.term(robot, self.library) for effect in self.effects)
        dynamics = self.weights.dynamics(robot, threads, self.library)
        return Subject(self.name, dynamics, self.dataset, terms)
