"""Dynamics models: all implementations of `rollout` (see `protocol.Dynamics`)."""

from flywheel.dynamics.baselines import Persistence
from flywheel.dynamics.plant import PlantDynamics, RestartedPlant

__all__ = ["Persistence", "PlantDynamics", "RestartedPlant"]
