"""Dynamics models: all implementations of `rollout` (see `protocol.Dynamics`)."""

from flywheel.dynamics.baselines import Persistence
from flywheel.dynamics.plant import (
    MeasurementModel,
    Plant,
    PlantDynamics,
    PlantParameters,
    RestartedPlant,
)
from flywheel.dynamics.protocol import Dynamics

__all__ = [
    "Dynamics",
    "MeasurementModel",
    "Persistence",
    "Plant",
    "PlantDynamics",
    "PlantParameters",
    "RestartedPlant",
]
