"""Settings of the network that corrects a plant."""

from __future__ import annotations

from typing import Annotated

from flywheel.effects import Scales
from flywheel.quantities import Bounds
from flywheel.robots import Robot
from flywheel.validation import Frozen


class ResidualConfig(Frozen):
    """Shape and inputs of a `ResidualNetwork`; times are in the robot's own unit, sqrt(L / g).

    Attributes:
      width: of all latent vectors.
      interval: between the instants of correction; rounded to control steps. Between them the
        correction is linear.
      past: how far back the plant is started once more, to give the network its past errors;
        rounded to intervals.
      clearance: height above the ground up to which it is an input of a tracked point, as a
        fraction of L.
    """

    width: Annotated[int, Bounds(4, 1024)] = 48
    interval: Annotated[float, Bounds(0.001, 10, "sqrt(L / g)")] = 0.2
    past: Annotated[float, Bounds(0, 100, "sqrt(L / g)")] = 1.0
    clearance: Annotated[float, Bounds(0, 10, "L", above=True)] = 0.2

    def every(self, robot: Robot, dt: float) -> int:
        """Control steps between two corrections."""
        return max(1, round(self.interval * Scales.of(robot).time / dt))

    def past_knots(self) -> int:
        """Number of corrections in the past."""
        return round(self.past / self.interval)
