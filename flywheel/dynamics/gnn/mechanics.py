"""Analytic cables and gravity beside a network, which then predicts only the rest: contacts."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.baselines.mechanics import Mechanics, RigidState
from flywheel.dynamics.gnn.attachments import Attachments, upright
from flywheel.dynamics.gnn.features import MechanicalState
from flywheel.dynamics.gnn.rigid import Frames
from flywheel.records import Floats
from flywheel.robots import Robot


class AnalyticMechanics:
    """Changes of the body nodes' velocities by cables and gravity in one control step.

    Args:
      robot: the robot, with the attachments that are assumed.
      frames: layout of the rigid frames.
      attachments: of the robot's cables.
      dt: control step [s].
    """

    def __init__(self, robot: Robot, frames: Frames, attachments: Attachments, dt: float) -> None:
        device, n = frames.to_nodes.device, len(robot.bodies)
        self._mechanics, self._dt = Mechanics(robot, str(device)), dt
        self._frames, self._attachments = frames, attachments

        def tensor(array: Floats) -> Tensor:
            return torch.as_tensor(array, dtype=torch.float64, device=device)

        bodies, com = list(range(n)), np.array([body.com for body in robot.bodies])
        self._centres = tensor(frames.along(bodies, com))
        principal = np.array([body.principal for body in robot.bodies])
        rods = list(frames.rods)
        axes = np.zeros((3 * n, frames.rows + 2 * len(rods)))
        for j in range(3):
            rows, tips = slice(j * n, (j + 1) * n), com + principal[:, :, j]
            axes[rows, : frames.rows] = frames.along(bodies, tips) - frames.along(bodies, com)
            for i, b in enumerate(rods):
                across = frames.across(b, tips[b]) - frames.across(b, com[b])
                axes[j * n + b, frames.rows + i :: len(rods)] = across
        self._axes = tensor(axes)
        # Turning rates: the sum of v x v' over a rod's only vector, or half of it over three.
        turning = np.zeros((n, frames.rows))
        for b in bodies:
            vectors = frames.vector_rows(b)
            turning[b, vectors] = 1.0 if len(vectors) == 1 else 0.5
        self._turning = tensor(turning)
        self._from_nodes, self._to_arms = frames.from_nodes.double(), frames.to_arms.double()
        self._of_node = frames.body_of_node

    def pushed(self, state: MechanicalState, origin: Tensor) -> MechanicalState:
        """The state with the velocities that cables and gravity alone would give it after the step.

        Args:
          state: with the sides of its rods.
          origin: (2, K) horizontal position of the state's origin in the world [m].
        """
        frames, velocities = state.frames.double(), state.velocities.double()
        assert state.sides is not None
        axis = frames[:, self._attachments.axes]
        side = upright(state.sides.double(), axis)
        basis = torch.cat([frames, side, torch.linalg.cross(axis, side, dim=0)], dim=1)
        shift = torch.cat([origin, torch.zeros_like(origin[:1])]).double()
        moving = torch.matmul(self._from_nodes, velocities)
        body = RigidState(
            torch.matmul(self._centres, frames) + shift[:, None],
            torch.matmul(self._axes, basis).unflatten(1, (3, -1)),
            torch.matmul(self._centres, moving),
            torch.matmul(self._turning, torch.linalg.cross(frames, moving, dim=0)),
        )
        rest = self._attachments.rest(state.winch).double()
        change, turn = self._mechanics.change(body, rest, self._dt)
        arms = torch.matmul(self._to_arms, frames)
        faster = change[:, self._of_node] + torch.linalg.cross(turn[:, self._of_node], arms, dim=0)
        return dataclasses.replace(state, velocities=(velocities + faster).to(state.velocities))
