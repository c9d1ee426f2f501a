"""One simulation that goes on piece by piece, as an episode is recorded."""

from __future__ import annotations

from typing import Protocol

from flywheel.records import Floats, State, Trajectory


class Course(Protocol):
    """A plant on its way through one episode.

    Attributes:
      state: (1,) where it is now.
    """

    state: State

    def go(self, controls: Floats) -> Trajectory:
        """Go on under controls (1, T, W), from the state now.

        Raises:
          ModelError: controls that do not fit, or the simulation diverged.
        """
        ...
