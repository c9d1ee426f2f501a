"""A plant and a small network trained on the plant's residual on a robot's recordings."""

from flywheel.dynamics.residual.config import ResidualConfig
from flywheel.dynamics.residual.model import Lookout, ResidualDynamics, Sight
from flywheel.dynamics.residual.motion import Knots, knots_of, mean_offsets
from flywheel.dynamics.residual.network import ResidualNetwork, displaced
from flywheel.dynamics.residual.weights import CorrectedPlant, ResidualWeights, is_residual

__all__ = [
    "CorrectedPlant",
    "Knots",
    "Lookout",
    "ResidualConfig",
    "ResidualDynamics",
    "ResidualNetwork",
    "ResidualWeights",
    "Sight",
    "displaced",
    "is_residual",
    "knots_of",
    "mean_offsets",
]
