"""A model under comparison or diagnosis."""

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
      dataset: index of the data set given to it for the recordings.
      terms: known effects of the robot beyond its MJCF: used to reckon unmeasured winches.
    """

    name: str
    dynamics: Dynamics
    dataset: int = 0
    terms: Terms = ()

    @classmethod
    def of_plant(cls, name: str, plant: Plant) -> Self:
        """MuJoCo, started from the observed past.

        Args:
          name: for people.
          plant: with its known effects.
        """
        return cls(name, RestartedPlant.from_measurements(plant), terms=plant.terms)
