"""Baselines: simpler dynamics models beside which the network is measured."""

from flywheel.dynamics.baselines.linear import LinearConfig, LinearDynamics
from flywheel.dynamics.baselines.persistence import Persistence

# `engine`, `named` and `weights` are imported from their modules: they take torch along.
__all__ = ["LinearConfig", "LinearDynamics", "Persistence"]
