"""A trained model as it is handed to workers."""

from __future__ import annotations

from dataclasses import dataclass

from flywheel.diagnosis.fitting.subject import Subject
from flywheel.effects import NAMED
from flywheel.robots import Robot
from flywheel.runtime.workers.episode_plan import Effects
from flywheel.runtime.workers.model_weights import Weights


@dataclass(frozen=True)
class TrainedModel:
    """Weights with a name.

    Attributes:
      name: for people.
      weights: of the network.
      dataset: index of the data set that it is told recordings belong to.
      effects: that the robot was known to have when it was trained.
    """

    name: str
    weights: Weights
    dataset: int = 0
    effects: Effects = ()

    def subject(self, robot: Robot, threads: int = 1) -> Subject:
        """The model itself."""
        terms = tuple(effect.term(robot, NAMED) for effect in self.effects)
        return Subject(self.name, self.weights.dynamics(robot, threads), self.dataset, terms)
