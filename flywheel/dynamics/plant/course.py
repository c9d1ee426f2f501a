"""One simulation that continues piece by piece, as in the recording of an episode."""

from __future__ import annotations

from typing import Protocol

from flywheel.records import Floats, State, Trajectory


class Course(Protocol):
    """A plant within one episode.

    Attributes:
      state: (1,) present state.
    """

    state: State

    def go(self, controls: Floats) -> Trajectory:
        """Continue under controls (1, T, W) from the present state.

        Raises:
          ModelError: controls do not fit, or the simulation diverged.
        """
        ...
