"""A model that is looked into: compared with recordings, or diagnosed."""

from __future__ import annotations

from dataclasses import dataclass

from flywheel.dynamics.protocol import Dynamics


@dataclass(frozen=True)
class Subject:
    """A dynamics model with a name.

    Attributes:
      name: for people.
      dynamics: predicts.
      dataset: index of the data set that it is told the recordings belong to.
    """

    name: str
    dynamics: Dynamics
    dataset: int = 0
