"""A model that is looked into: compared with recordings, or diagnosed."""

from __future__ import annotations

from dataclasses import dataclass

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
