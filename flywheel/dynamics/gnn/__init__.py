"""The graph network as a dynamics model: configuration, weights, differentiable simulator."""

from flywheel.dynamics.gnn.batch import Batch
from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.devices import check_device
from flywheel.dynamics.gnn.learned import LearnedDynamics
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.dynamics.gnn.normalisation import fit_normalisation, widen_winches
from flywheel.dynamics.gnn.simulator import Simulator
from flywheel.dynamics.gnn.weights import load_weights, save_weights, seeing, weights_digest
from flywheel.dynamics.rigid_bodies.ground import View, ground_of

__all__ = [
    "Batch",
    "ChunkNetwork",
    "LearnedDynamics",
    "NetworkConfig",
    "Simulator",
    "View",
    "check_device",
    "fit_normalisation",
    "ground_of",
    "load_weights",
    "save_weights",
    "seeing",
    "weights_digest",
    "widen_winches",
]
