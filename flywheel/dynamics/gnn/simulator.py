"""Predict points from a measured past and controls, differentiable through all chunks.

Within a prediction chunk the body nodes move freely, by semi-implicit Euler steps with the
predicted velocities; rigid bodies are then fitted to them at every step. The output is rigid at
every step. The fit at the chunk's last step is the start of the next chunk, with the velocities of
the fitted nodes over that step: the same definition as for a measured past.
"""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from flywheel.dynamics.arithmetic import Precision
from flywheel.dynamics.gnn.compiled_network import prepared
from flywheel.dynamics.gnn.compiled_step import CompiledStep
from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.features import MechanicalState
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.dynamics.gnn.prediction import (
    Forward,
    ForwardFactory,
    Memory,
    Start,
    Unrolled,
    expanded,
)
from flywheel.dynamics.gnn.step import Parts, Step, StepFactory, TorchStep
from flywheel.dynamics.rigid_bodies.ground import Ground, flat_ground
from flywheel.errors import ModelError
from flywheel.robots import GRAVITY, Robot

Array = Tensor | NDArray[np.floating]


def step_of(parts: Parts) -> Step:
    """The faster implementation on a device."""
    return CompiledStep(parts) if parts.device.type == "cpu" else TorchStep(parts)


class Simulator:
    """Runs a network on a robot.

    Args:
      robot: the robot.
      config: the network's.
      prepare: implementation of the network's forward pass; by default compiled kernels where they
        serve the configuration and the device, else torch operations.
      step: implementation of the rest, likewise.
      precision: of the compiled kernels' matrix products.
    """

    def __init__(
        self,
        robot: Robot,
        config: NetworkConfig,
        prepare: ForwardFactory | None = None,
        step: StepFactory = step_of,
        precision: Precision = "float32",
    ) -> None:
        self.robot, self.config, self.dt = robot, config, config.dt
        self._prepare, self._step = prepare or partial(prepared, precision=precision), step
        self._steps: dict[torch.device, Step] = {}
        self._parts: dict[torch.device, Parts] = {}

    def parts(self, device: torch.device | str = "cpu") -> Parts:
        """Graph, frames, features and winches on a device."""
        device = torch.device(device)
        if device not in self._parts:
            self._parts[device] = Parts(self.robot, self.config, device)
        return self._parts[device]

    def _step_on(self, parts: Parts) -> Step:
        if parts.device not in self._steps:
            self._steps[parts.device] = self._step(parts)
        return self._steps[parts.device]

    def node_positions(self, points: Tensor) -> Tensor:
        """Positions of the N body nodes, (..., N, 3), if the tracked points are at (..., P, 3).

        NaN for all nodes of a body that misses a point.
        """
        frames = self.parts(points.device).frames
        missing = ~torch.isfinite(points).all(-1)
        shape = points.shape[:-2]
        flat = torch.nan_to_num(points.float()).reshape(-1, *points.shape[-2:]).permute(2, 1, 0)
        nodes = torch.matmul(frames.to_nodes, frames.of_points(flat))
        lost = torch.zeros(*shape, len(self.robot.bodies), device=points.device)
        lost = lost.index_add(-1, frames.body_of_point, missing.float())[..., frames.body_of_node]
        nodes = nodes.permute(2, 1, 0).reshape(*shape, -1, 3)
        return nodes.masked_fill((lost > 0)[..., None], torch.nan)

    def prepare(self, network: ChunkNetwork, device: torch.device | str = "cpu") -> Forward:
        """A network prepared for `roll`; later changes of its weights have no effect.

        Raises:
          ModelError: the network is of another robot or configuration.
        """
        if network.robot_digest != self.robot.digest or network.config != self.config:
            raise ModelError(
                f"The network was made for robot {network.robot_digest[:12]} and {network.config!r}; "
                f"this simulator runs robot {self.robot.name} ({self.robot.digest[:12]}) with "
                f"{self.config!r}."
            )
        return self._prepare(network, self.parts(device).graph)

    def unroll(
        self,
        network: ChunkNetwork,
        past_points: Tensor,
        past_controls: Tensor,
        past_winch: Tensor,
        controls: Tensor,
        dataset: Tensor,
        ground: Ground = flat_ground,
    ) -> Unrolled:
        """Predict T steps from the present, the past's last entry. h is `config.history`.

        Args:
          network: the weights.
          past_points: (B, h + 1, P, 3) measured points [m]; NaN where missing.
          past_controls: (B, h, W) commands between them.
          past_winch: (B, h + 1, W) winch positions [m]; NaN where unknown.
          controls: (B, T, W) future commands; T need not be a multiple of the chunk.
          dataset: (B,) int64 index of the data set.
          ground: below the robot.

        The past may have batch size 1, to start all B from the same present; so may `dataset`.

        Raises:
          ModelError: shapes, robot or configuration do not fit, or a point is missing in the whole
            past.
        """
        self.check(past_points, past_controls, past_winch, controls)
        forward = self.prepare(network, controls.device)
        start = self.start(past_points, past_controls, past_winch, ground)
        return self.roll(forward, start, controls, dataset)

    def start(
        self,
        past_points: Tensor,
        past_controls: Tensor,
        past_winch: Tensor,
        ground: Ground = flat_ground,
    ) -> Start:
        """Initial states from a measured past; arguments as of `unroll`."""
        parts = self.parts(past_controls.device)
        present = past_points[:, -1, :, :2]
        seen = torch.isfinite(present)
        total = torch.where(seen, present, torch.zeros_like(present)).sum(1)
        origin = total / seen.sum(1).clamp(min=1)
        shift = torch.cat([origin, torch.zeros_like(origin[:, :1])], dim=1)
        points = (past_points - shift[:, None, None]).float().permute(3, 1, 2, 0).contiguous()
        controls = parts.winches.clipped(past_controls.float().permute(1, 2, 0))
        winch = parts.winches.present(past_winch.float().permute(1, 2, 0), controls)
        states, place = parts.past.states(points, winch), origin.float().t()
        if self.config.cable_ends == "attachments":
            sides = parts.attachments.find(states[-1].frames, place, winch)
            states[-1] = dataclasses.replace(states[-1], sides=sides)
        return Start(place, states, controls, ground)

    def roll(self, forward: Forward, start: Start, controls: Tensor, dataset: Tensor) -> Unrolled:
        """Predict from a start; see `unroll`."""
        parts, config = self.parts(controls.device), self.config
        step = self._step_on(parts)
        samples, steps, _ = controls.shape
        memory = self._warm_up(parts, forward, start, dataset)
        state, memory, origin = expanded(start, memory, samples)
        commands = parts.winches.clipped(controls.float().permute(1, 2, 0))
        missing = -steps % config.chunk
        commands = torch.cat([commands, parts.winches.held(commands[-1], missing)])
        shown = parts.winches.scaled(
            torch.cat([start.controls.expand(-1, -1, samples), commands])
        ).permute(1, 2, 0)
        first = config.history - config.control_history
        width = config.control_history + config.chunk
        taken: list[tuple[Tensor, ...]] = []
        for t in range(0, steps, config.chunk):
            state = self.pushed(state, origin)
            window = shown[..., first + t : first + t + width]
            features = step.features(state, origin, window, dataset, start.ground)
            said = forward(features, memory)
            state, outcome = step.advance(state, origin, said, commands[t : t + config.chunk])
            memory = said.memory
            taken.append(outcome)
        frames, velocities, winch = (torch.cat(part, dim=-3) for part in zip(*taken, strict=True))
        return self._unrolled(parts, origin, frames, velocities, winch, steps)

    def pushed(self, state: MechanicalState, origin: Tensor) -> MechanicalState:
        """A state with the velocities that analytic mechanics give it; itself without such mechanics.

        Args:
          state: at the start of a chunk.
          origin: (2, K) horizontal position of the state's origin in the world [m].
        """
        if self.config.mechanics == "learned":
            return state
        change = GRAVITY * self.dt * self.parts(origin.device).builder.loaded(state, origin)
        return dataclasses.replace(state, velocities=state.velocities + change)

    def _warm_up(
        self, parts: Parts, forward: Forward, start: Start, dataset: Tensor
    ) -> Memory | None:
        memory: Memory | None = None
        for state in start.states[:-1]:
            shown = parts.builder.memory_features(state, start.origin, start.ground)
            memory = forward.warm_up(shown, dataset, memory)
        return memory

    def _unrolled(
        self,
        parts: Parts,
        origin: Tensor,
        frames: Tensor,
        velocities: Tensor,
        winch: Tensor,
        steps: int,
    ) -> Unrolled:
        """The first `steps` steps, sample-major and in the world."""
        frames, velocities, winch = frames[:, :steps], velocities[:, :steps], winch[:steps]
        shift = torch.cat([origin, torch.zeros_like(origin[:1])]).t()[:, None, None]

        def placed(matrix: Tensor) -> Tensor:
            return torch.matmul(matrix, frames).permute(3, 1, 2, 0) + shift

        return Unrolled(
            points=placed(parts.frames.to_points),
            node_positions=placed(parts.frames.to_nodes),
            velocities=velocities.permute(3, 1, 2, 0),
            winch=winch.permute(2, 0, 1),
        )

    def present(self, start: Start) -> tuple[Tensor, Tensor]:
        """(K, P, 3) tracked points and (K, W) winch positions at the start of predictions [m]."""
        state, frames = start.states[-1], self.parts(start.origin.device).frames
        shift = torch.cat([start.origin, torch.zeros_like(start.origin[:1])]).t()
        points = torch.matmul(frames.to_points, state.frames).permute(2, 1, 0) + shift[:, None]
        return points, state.winch.t()

    def check(self, points: Array, past: Array, winch: Array, controls: Array) -> None:
        """Check shapes; arguments as of `unroll`. Raises a `ModelError`."""
        robot, history = self.robot, self.config.history
        batch, winches = len(points), len(robot.winches)
        wanted = {
            "past_points": (points, (batch, history + 1, len(robot.points), 3)),
            "past_controls": (past, (batch, history, winches)),
            "past_winch": (winch, (batch, history + 1, winches)),
            "controls": (controls, (*controls.shape[:2], winches)),
        }
        for name, (array, shape) in wanted.items():
            if tuple(array.shape) != shape:
                raise ModelError(
                    f"{name} must have shape {shape} for robot {robot.name} and a history of "
                    f"{history} steps, got {tuple(array.shape)}."
                )
        if batch not in (1, len(controls)) or controls.shape[1] == 0:
            raise ModelError(
                "The past must have batch size 1 or that of the controls, which must have at "
                f"least one step; got a past of {batch} and controls {tuple(controls.shape)}."
            )
