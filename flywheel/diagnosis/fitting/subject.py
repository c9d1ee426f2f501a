"""A model that is looked into: compared with recordings, or diagnosed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import Terms


@dataclass(frozen=True)
class Subject:
    """A dynamics model with a name.

    Attributes:
      name: for people.
      dynamics: predicts.
      dataset: index of the data set that it is told the recordings belong to.
      terms: what it was told that the robot has beyond its MJCF: winches that nobody measures are
        reckoned with that.
    """

    name: str
    dynamics: Dynamics
    dataset: int = 0
    terms: Terms = ()

    @classmethod
    def of_plant(cls, name: str, plant: Plant) -> Self:
        """MuJoCo, started from what is seen of the past.

        Args:
          name: for people.
          plant: with the effects that it is told of.
        """
        return cls(name, RestartedPlant.from_measurements(plant), terms=plant.terms)
