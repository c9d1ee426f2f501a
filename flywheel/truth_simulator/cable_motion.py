"""State of the cables at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.records import Floats


@dataclass(frozen=True)
class CableMotion:
    """All C cables at one moment.

    Attributes:
      time: since the recording's start, negative while the robot settles [s].
      step: the simulator's time step [s].
      length, rate: (C,) [m] and [m/s].
      rest, rest_rate: (C,) rest length [m] and its rate [m/s].
      stiffness: (C,) [N/m].
    """

    time: float
    step: float
    length: Floats
    rate: Floats
    rest: Floats
    rest_rate: Floats
    stiffness: Floats

    @property
    def extension(self) -> Floats:
        """(C,) length beyond the rest length [m], negative when slack."""
        return self.length - self.rest

    @property
    def taut(self) -> np.ndarray:
        """(C,) bool."""
        return self.length > self.rest

    @property
    def tension(self) -> Floats:
        """(C,) elastic tension [N]."""
        return self.stiffness * np.maximum(self.length - self.rest, 0.0)
