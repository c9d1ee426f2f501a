"""What a forward pass takes and gives, whichever way it computes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

from flywheel.dynamics.gnn.features import GraphFeatures
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.network import ChunkNetwork

Memory = tuple[Tensor, Tensor]
"""The LSTM's hidden and cell state, (N K, width) each, node-major."""


@dataclass(frozen=True)
class Prediction:
    """What one call of the network says about its n steps, in the axes it was shown.

    Attributes:
      velocity: (3, n, N, K) velocity changes since the chunk's start [m/s].
      winch: (n, W, K) winch position changes since the chunk's start [m]; None if not learned.
      memory: of the LSTM afterwards; None without one.
    """

    velocity: Tensor
    winch: Tensor | None
    memory: Memory | None


class Forward(Protocol):
    """One way of computing the network."""

    def remember(self, nodes: Tensor, dataset: Tensor, memory: Memory | None) -> Memory | None:
        """Run only the LSTM over features of the body nodes (F, N, K)."""
        ...

    def __call__(self, features: GraphFeatures, memory: Memory | None) -> Prediction:
        """Predict one chunk."""
        ...


Prepare = Callable[[ChunkNetwork, RobotGraph], Forward]
