"""Accelerations of a robot's nodes that cables and gravity alone would cause, by the robot's numbers.

A network that is shown strains has to learn products of lengths, directions and stiffness, and levers,
before it can predict the simplest motion. Their result is an input instead: each node's acceleration if
nothing but gravity and the cables acted on its body. What contacts and winches change in it, and a robot
unlike its numbers, remains to be learned.

Arrays are component-major: (3, ..., M, K) for M items of K samples.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.gnn.attachments import Attachments
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.rigid import Frames
from flywheel.dynamics.rigid_bodies.mechanics import tension
from flywheel.records import Floats
from flywheel.robots import Body


class CableLoads:
    """Accelerations by cables and gravity; ends 2c and 2c + 1 are those of cable c.

    Torque T gives a body an angular acceleration of `ease` T, and `more` (a . T) a for each of its axes a.
    Forces are in weights of the robot, and accelerations in g.

    Args:
      graph: the robot's graph.
      frames: layout of its rigid frames.
      attachments: of its cables.

    Attributes:
      stiffness, damping: (C, 1) in weights of the robot per metre, and per m/s.
      driven: (C, 1) the cable has a winch: it pulls or does nothing. A passive one is damped when slack, too.
      of_end: (2 C,) body of each end, -1 for the world.
      of_axis: (Q,) body of each axis.
      lightness: (B, 1) weight of the robot over that of each body.
      ease, more: (B, 1) and (Q, 1) [1/m^2].
      centres, axes: (B, F) and (Q, F) from frames to the bodies' centres of mass, and to their axes.
    """

    def __init__(self, graph: RobotGraph, frames: Frames, attachments: Attachments) -> None:
        robot, edge = graph.robot, attachments.edge
        self.stiffness, self.damping = graph.stiffness[edge], graph.damping[edge]
        self.driven = (graph.cable_winch[edge] < len(robot.winches))[:, None]
        ends = [end.body for cable in robot.cables for end in cable.ends]
        self.of_end = torch.as_tensor(ends, dtype=torch.int64, device=graph.device)
        self.of_node = frames.body_of_node
        mass = sum(body.mass for body in robot.bodies)
        turns = [_turns(body, frames.vectors(b)) for b, body in enumerate(robot.bodies)]
        owners = [b for b, (_, _, axes) in enumerate(turns) for _ in axes]
        bodies, com = list(range(len(turns))), np.array([body.com for body in robot.bodies])
        tips = com[owners] + np.concatenate([axes for _, _, axes in turns])

        def tensor(array: Floats) -> Tensor:
            return torch.as_tensor(array, dtype=torch.float32, device=graph.device)

        self.lightness = tensor(np.array([[mass / body.mass] for body in robot.bodies]))
        self.ease = tensor(mass * np.array([[ease] for ease, _, _ in turns]))
        self.more = tensor(mass * np.concatenate([more for _, more, _ in turns])[:, None])
        self.of_axis = torch.as_tensor(owners, dtype=torch.int64, device=graph.device)
        self.centres = tensor(frames.along(bodies, com))
        self.axes = tensor(frames.along(owners, tips) - frames.along(owners, com[owners]))
        count = torch.arange(len(turns), device=graph.device)[:, None]
        self._on_body = (self.of_end == count).float()
        self._of_body = (self.of_axis == count).float()

    def accelerations(
        self, frames: Tensor, arms: Tensor, ends: Tensor, speeds: Tensor, rest: Tensor
    ) -> Tensor:
        """(3, N, K) accelerations of the body nodes [g], in world axes.

        Args:
          frames: (3, F, K) rigid frames.
          arms: (3, N, K) from the centre of mass of each node's body to the node [m].
          ends, speeds: (3, 2 C, K) of the cables [m], [m/s].
          rest: (C, K) rest lengths of the cables [m].
        """
        way, apart = (x[:, 1::2] - x[:, ::2] for x in (ends, speeds))
        length = (way * way).sum(0).clamp(min=1e-18).sqrt()
        unit = way / length
        load = self.stiffness * (length - rest)
        drag = self.damping * (unit * apart).sum(0)
        pull = tension(load, drag, self.driven)
        force = torch.stack([pull * unit, -pull * unit], dim=2).flatten(1, 2)
        centres, axes = torch.matmul(self.centres, frames), torch.matmul(self.axes, frames)
        lever = ends - centres[:, self.of_end]  # an end in the world is on no body
        torque = torch.matmul(self._on_body, torch.linalg.cross(lever, force, dim=0))
        about = (axes * torque[:, self.of_axis]).sum(0)
        turning = self.ease * torque + torch.matmul(self._of_body, self.more * about * axes)
        fall = torch.tensor([0.0, 0.0, 1.0], device=force.device)[:, None, None]
        moving = self.lightness * torch.matmul(self._on_body, force) - fall
        node = self.of_node
        return moving[:, node] + torch.linalg.cross(turning[:, node], arms, dim=0)


def _turns(body: Body, visible: Floats) -> tuple[float, Floats, Floats]:
    """`ease`, `more` (q,) and axes (q, 3) of a body, in its frame; see `CableLoads`.

    Args:
      body: with its moments of inertia.
      visible: (r, 3) its visible directions. About a single one no rotation is seen; without any, none.
    """
    moments, principal = np.asarray(body.inertia), body.principal
    if len(visible) == 0:
        return 0.0, np.zeros(0), np.zeros((0, 3))
    if len(visible) == 1:
        along = float(moments @ (visible[0] @ principal) ** 2)
        across = 2.0 / (float(moments.sum()) - along)
        return across, np.array([-across]), visible
    every = 1.0 / moments
    return float(every[2]), every[:2] - every[2], principal[:, :2].T
