"""Records passed between the simulator and a network's forward pass, shared by all implementations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

from flywheel.dynamics.gnn.features import GraphFeatures, MechanicalState
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.dynamics.rigid_bodies.ground import Ground, flat_ground

Memory = tuple[Tensor, Tensor]
"""The LSTM's hidden and cell state, (N K, width) each, node-major."""


@dataclass(frozen=True)
class Prediction:
    """Output of one call of the network for its n steps, in the input frame.

    Attributes:
      velocity: (3, n, N, K) velocity changes since the chunk's start [m/s].
      winch: (n, W, K) winch position changes since the chunk's start [m]; None if not learned.
      memory: of the LSTM afterwards; None without one.
    """

    velocity: Tensor
    winch: Tensor | None
    memory: Memory | None


class Forward(Protocol):
    """An implementation of the forward pass."""

    def warm_up(self, nodes: Tensor, dataset: Tensor, memory: Memory | None) -> Memory | None:
        """Run only the LSTM over features of the body nodes (F, N, K)."""
        ...

    def __call__(self, features: GraphFeatures, memory: Memory | None) -> Prediction:
        """Predict one chunk."""
        ...


ForwardFactory = Callable[[ChunkNetwork, RobotGraph], Forward]


@dataclass(frozen=True)
class Unrolled:
    """A prediction of T control steps.

    Attributes:
      points: (B, T, P, 3) tracked points, each body rigid [m].
      node_positions: (B, T, N, 3) body nodes, each body rigid [m].
      velocities: (B, T, N, 3) predicted velocities of the body nodes, before the rigid fit [m/s].
      winch: (B, T, W) winch positions [m].
    """

    points: Tensor
    node_positions: Tensor
    velocities: Tensor
    winch: Tensor


@dataclass(frozen=True)
class Start:
    """Start of a prediction, component-major; K = 1 if all samples share a start.

    Attributes:
      origin: (2, K) horizontal position of the states' origin in the world [m].
      states: for the warm-up, oldest first, and last the present one.
      controls: (h, W, K) past commands, within the winches' range.
      ground: below the robot.
    """

    origin: Tensor
    states: list[MechanicalState]
    controls: Tensor
    ground: Ground = flat_ground


def expanded(
    start: Start, memory: Memory | None, samples: int
) -> tuple[MechanicalState, Memory | None, Tensor]:
    """Present state, memory and origin for all samples, from one start for all or one for each."""
    state, have = start.states[-1], start.origin.shape[-1]
    if have == samples:
        return state, memory, start.origin
    state = MechanicalState(
        state.frames.expand(-1, -1, samples),
        state.velocities.expand(-1, -1, samples),
        state.winch.expand(-1, samples),
        None if state.sides is None else state.sides.expand(-1, -1, samples),
    )
    if memory is not None:
        hidden, cell = (m[:, None].expand(-1, samples, -1).flatten(0, 1) for m in memory)
        memory = (hidden, cell)
    return state, memory, start.origin.expand(-1, samples)
