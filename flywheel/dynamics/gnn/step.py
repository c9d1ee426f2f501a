"""One prediction chunk around the network: its inputs before, the integration after."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import torch
from torch import Tensor

from flywheel.dynamics.gnn.attachments import Attachments
from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.features import FeatureBuilder, GraphFeatures, MechanicalState, turn_back
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.past import PastReader
from flywheel.dynamics.gnn.prediction import Prediction
from flywheel.dynamics.gnn.rigid import Frames
from flywheel.dynamics.gnn.winches import Winches
from flywheel.dynamics.rigid_bodies.ground import Ground
from flywheel.robots import Robot

Motion = tuple[Tensor, Tensor, Tensor]
"""Rigid frames (3, n, F, K), velocities of the nodes (3, n, N, K) and winch positions (n, W, K) of a
chunk's steps."""


class Parts:
    """Quantities derived from a robot and a network's configuration, on one device.

    Args:
      robot: the robot.
      config: the network's.
      device: of all tensors.
    """

    def __init__(self, robot: Robot, config: NetworkConfig, device: torch.device) -> None:
        self.config, self.device = config, device
        self.graph = RobotGraph(robot, config, device)
        self.frames = Frames(robot, self.graph.nodes, device)
        self.attachments = Attachments(self.graph, self.frames)
        self.builder = FeatureBuilder(self.graph, self.frames, self.attachments)
        self.past = PastReader(robot, config, self.frames)
        self.winches = Winches(robot, config.dt, device)


class Step(Protocol):
    """An implementation of what a chunk needs besides the network."""

    def features(
        self,
        state: MechanicalState,
        origin: Tensor,
        controls: Tensor,
        dataset: Tensor,
        ground: Ground,
    ) -> GraphFeatures:
        """The network's inputs; arguments as of `FeatureBuilder`."""
        ...

    def advance(
        self, state: MechanicalState, origin: Tensor, said: Prediction, commands: Tensor
    ) -> tuple[MechanicalState, Motion]:
        """Integrate a prediction from `state`; the state at the chunk's end, and its motion.

        Args:
          state: at its start.
          origin: (2, K) horizontal position of the state's origin in the world [m].
          said: by the network.
          commands: (n, W, K) within the winches' range.
        """
        ...


StepFactory = Callable[[Parts], Step]


class TorchStep:
    """In torch operations, on any device: the readable form.

    Args:
      parts: of the robot.
    """

    def __init__(self, parts: Parts) -> None:
        self._parts, self._config = parts, parts.config
        chunk = torch.ones(parts.config.chunk, parts.config.chunk, device=parts.device)
        self._integrate = parts.config.dt * chunk.tril()

    def features(
        self,
        state: MechanicalState,
        origin: Tensor,
        controls: Tensor,
        dataset: Tensor,
        ground: Ground,
    ) -> GraphFeatures:
        """See `Step`."""
        builder = self._parts.builder
        return builder(state, origin, builder.heading(state), controls, dataset, ground)

    def advance(
        self, state: MechanicalState, origin: Tensor, said: Prediction, commands: Tensor
    ) -> tuple[MechanicalState, Motion]:
        """See `Step`."""
        parts, frames = self._parts, self._parts.frames
        heading = parts.builder.heading(state)
        change = said.velocity if heading is None else turn_back(said.velocity, heading)
        velocities = state.velocities[:, None] + change
        before = torch.matmul(frames.to_nodes, state.frames)
        moved = torch.matmul(self._integrate, velocities.flatten(2)).view_as(velocities)
        fitted = frames.of_nodes(before[:, None] + moved)
        last = torch.cat([state.frames[:, None], fitted], dim=1)[:, -2:]
        nodes = torch.matmul(frames.to_nodes, last)
        speed = (nodes[:, 1] - nodes[:, 0]) / self._config.dt
        winch = self._wind(state.winch, said.winch, commands)
        sides = state.sides
        if sides is not None:
            sides = parts.attachments.follow(fitted[:, -1], sides, origin, winch[-1])
        after = MechanicalState(fitted[:, -1], speed, winch[-1], sides)
        return after, (fitted, velocities, winch)

    def _wind(self, position: Tensor, change: Tensor | None, commands: Tensor) -> Tensor:
        """(n, W, K) winch positions within a chunk."""
        winches = self._parts.winches
        if self._config.winch == "learned":
            assert change is not None
            return winches.within(position + change)
        nominal = winches.nominal(position, commands)
        return nominal if change is None else winches.within(nominal + change)
