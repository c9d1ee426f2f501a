"""The plant as a dynamics model with full state: the ceiling for all planners."""

from __future__ import annotations

from dataclasses import dataclass

from flywheel.dynamics.plant.grounds import simulated_on
from flywheel.dynamics.plant.plant import Plant
from flywheel.errors import ModelError
from flywheel.records import Floats, Past, Rollout
from flywheel.robots import Robot


@dataclass(frozen=True)
class PlantDynamics:
    """MuJoCo started from the plant's own full state.

    Attributes:
      plant: parameters and threads for the prediction; the past gives the terrain.
    """

    plant: Plant

    @property
    def robot(self) -> Robot:
        return self.plant.robot

    @property
    def dt(self) -> float:
        return self.plant.dt

    @property
    def history(self) -> int:
        return 0

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls` (B, H, W).

        Raises:
          ModelError: the past has no full state (a recording), shapes do not fit, or divergence.
        """
        if past.state is None:
            raise ModelError(
                "The oracle needs the plant's full state, which this past does not have; "
                "RestartedPlant predicts from observations."
            )
        seen = simulated_on(past.terrains, self.plant, past.state, controls).observations
        return Rollout(seen.points, seen.winch)
