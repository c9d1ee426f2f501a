"""Features of a plant's motion for the network, and the robot's connections and constants behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.gnn.nodes import cable_constants, standardised
from flywheel.dynamics.residual.config import ResidualConfig
from flywheel.dynamics.residual.motion import Knots, Units
from flywheel.effects import Scales
from flywheel.robots import Attachment, Robot

ERROR = 0.01  # typical of an error state, and of what the network corrects it by at the present [L, rad]
CABLE_FEATURES, POINT_FEATURES, BODY_FEATURES = 18, 13, 20
_LEAST_INERTIA = 1e-5  # of a body [robot's mass, L^2]
_NEAR = 10.0  # how sharply being near the ground is shown, per clearance


class Layout:
    """Connections and constants of one robot.

    The world is a body too, the last one; it does not move.

    Args:
      robot: the robot.
    """

    def __init__(self, robot: Robot) -> None:
        robot.require_rest_lengths("corrected by a network")
        scales = Scales.of(robot)
        self.units = Units(robot.length, scales.time)
        self.bodies, L = len(robot.bodies), robot.length
        pairs = [pair for c in robot.cables for pair in (c.ends, c.ends[::-1])]
        cable = np.repeat(np.arange(len(robot.cables)), 2)
        self.own, self.other = (
            _index([self._body(pair[side]) for pair in pairs]) for side in (0, 1)
        )
        com = np.array([*(b.com for b in robot.bodies), np.zeros(3)])
        self.com = _tensor(com[:-1] / L)
        self.own_arm, self.other_arm = (
            _tensor([(pair[side].offset - com[self._body(pair[side])]) / L for pair in pairs])
            for side in (0, 1)
        )
        self.cable = _index(cable)
        weight = scales.weight
        self.cable_constants = _tensor(cable_constants(robot))[self.cable]
        self.stiffness = _tensor([c.stiffness * L / weight for c in robot.cables])
        self.damping = _tensor([c.damping * self.units.speed / weight for c in robot.cables])
        self.winch = _index([c.winch for c in robot.cables])  # -1: the zero at the end
        self.ratio = _tensor(robot.ratios)
        first = [robot.cables[w.cables[0]].rest_length for w in robot.winches]
        self.first_rest = _tensor(np.array(first) / L)
        self.rest = _tensor([c.rest_length / L for c in robot.cables])
        self.point_body = _index([p.body for p in robot.points])
        self.point_arm = _tensor([(p.offset - com[p.body]) / L for p in robot.points])
        below = [[0.0, 0.0, -p.radius / L] for p in robot.points]
        self.below = _tensor(
            below
        )  # from a tracked point to where it touches the ground, in the world
        inertia = np.array([[b.mass, *b.inertia] for b in robot.bodies]) / scales.mass
        inertia[:, 1:] = np.maximum(inertia[:, 1:] / L**2, _LEAST_INERTIA)
        self.body_constants = _tensor(standardised(np.log(inertia)))
        self.masses, self.inertias = _tensor(inertia[:, 0]), _tensor(inertia[:, 1:])
        self.owns = _incidence(self.own, self.bodies)
        self.others = _incidence(self.other, self.bodies)
        self.carries = _incidence(self.point_body, self.bodies)

    def _body(self, end: Attachment) -> int:
        return end.body if end.body >= 0 else self.bodies


@dataclass(frozen=True)
class Shown:
    """Features at all knots, normalised only by the robot's units.

    Attributes:
      cables: (B, K, 2C, F) of each end of each cable.
      points: (B, K, P, F).
      bodies: (B, K, bodies, F).
      along: (B, K, 2C, 3) unit vectors from a cable's end to its other, in the world.
      arms: (B, K, 2C, 3) from the body's centre of mass to the end, in the world.
      length, strain: (B, K, 2C) length of the cable, and its excess over the rest length.
      point_arms: (B, K, P, 3) likewise to the tracked points.
      touch_speed: (B, K, P, 3) velocities of their contact places.
      height: (B, K, P) above the ground.
      turn: (B, K, bodies, 3, 3).
    """

    cables: Tensor
    points: Tensor
    bodies: Tensor
    along: Tensor
    arms: Tensor
    length: Tensor
    strain: Tensor
    point_arms: Tensor
    touch_speed: Tensor
    height: Tensor
    turn: Tensor


def features(layout: Layout, config: ResidualConfig, knots: Knots, past: bool) -> Shown:
    """Network inputs for a motion; `past` is True if it was measured."""
    spin = torch.einsum("bknij,bknj->bkni", knots.turn, knots.rate)
    com = torch.einsum("bknij,nj->bkni", knots.turn, layout.com)
    moving = knots.velocity + torch.linalg.cross(spin, com)
    turn, place = _with_world(knots, knots.place + com)
    still = torch.zeros_like(moving[:, :, :1])
    velocity, spin = torch.cat([moving, still], dim=2), torch.cat([spin, still], dim=2)

    def ends(body: Tensor, arm: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        out = torch.einsum("bknij,nj->bkni", turn[:, :, body], arm)
        speed = velocity[:, :, body] + torch.linalg.cross(spin[:, :, body], out)
        return out, place[:, :, body] + out, speed

    arms, here, speed = ends(layout.own, layout.own_arm)
    _, there, other_speed = ends(layout.other, layout.other_arm)
    apart, relative = there - here, other_speed - speed
    length = apart.norm(dim=-1, keepdim=True).clamp(min=1e-6)
    along = apart / length
    own_turn = turn[:, :, layout.own]
    strain, *loads = _loads(layout, knots, length)
    cables = torch.cat(
        [
            layout.own_arm.expand(*arms.shape),
            _into(own_turn, along),
            _into(own_turn, relative),
            (relative * along).sum(-1, keepdim=True),
            strain,
            *loads,
            layout.cable_constants.expand(*arms.shape[:3], -1),
        ],
        dim=-1,
    )
    point_arms, _, point_speed = ends(layout.point_body, layout.point_arm)
    points = _of_points(layout, config, knots, point_speed)
    return Shown(
        cables=cables,
        points=points,
        bodies=_of_bodies(layout, knots, moving, past),
        along=along,
        arms=arms,
        length=length[..., 0],
        strain=strain[..., 0],
        point_arms=point_arms,
        touch_speed=point_speed
        + torch.linalg.cross(spin[:, :, layout.point_body], layout.below.expand_as(point_arms)),
        height=knots.height,
        turn=knots.turn,
    )


def _of_points(layout: Layout, config: ResidualConfig, knots: Knots, speed: Tensor) -> Tensor:
    own_turn = knots.turn[:, :, layout.point_body]
    height = (knots.height / config.clearance).clamp(-1.0, 1.0)[..., None]
    return torch.cat(
        [
            layout.point_arm.expand(*speed.shape),
            height,
            torch.exp(-_NEAR * height.clamp(min=0.0)),
            _into(own_turn, speed),
            speed[..., 2:],
            torch.asinh(_into(own_turn, knots.off) / ERROR),
            knots.seen[..., None],
        ],
        dim=-1,
    )


def _loads(layout: Layout, knots: Knots, length: Tensor) -> tuple[Tensor, ...]:
    """Strain, tension, rest length, rest length against its nominal one, and command of each cable end."""
    out = torch.cat([knots.winch - layout.first_rest, torch.zeros_like(knots.winch[..., :1])], -1)
    told = torch.cat([knots.command, torch.zeros_like(knots.command[..., :1])], -1)
    paid = (layout.ratio * out[..., layout.winch])[..., layout.cable, None]
    rest = layout.rest[layout.cable, None] + paid
    strain = length - rest
    tension = torch.asinh(layout.stiffness[layout.cable, None] * strain.clamp(min=0.0))
    command = (layout.ratio * told[..., layout.winch])[..., layout.cable, None]
    return strain, tension, rest, paid, command


def _of_bodies(layout: Layout, knots: Knots, velocity: Tensor, past: bool) -> Tensor:
    up = knots.turn[..., 2, :]
    change = torch.zeros_like(velocity)
    change[:, 1:] = velocity[:, 1:] - velocity[:, :-1]
    turning = torch.zeros_like(knots.rate)
    turning[:, 1:] = knots.rate[:, 1:] - knots.rate[:, :-1]
    return torch.cat(
        [
            up,
            _into(knots.turn, velocity),
            knots.rate,
            _into(knots.turn, change),
            turning,
            layout.body_constants.expand(*up.shape[:3], -1),
            torch.full_like(up[..., :1], float(past)),
        ],
        dim=-1,
    )


def _into(turn: Tensor, vectors: Tensor) -> Tensor:
    """World vectors (..., 3) in body frames that are turned by (..., 3, 3)."""
    return torch.einsum("...ji,...j->...i", turn, vectors)


def _with_world(knots: Knots, place: Tensor) -> tuple[Tensor, Tensor]:
    """Rotations and positions (B, K, bodies, 3) of the bodies and, last, of the world."""
    batch, steps = place.shape[:2]
    eye = torch.eye(3).expand(batch, steps, 1, 3, 3)
    world = -knots.origin[:, None, None].expand(batch, steps, 1, 3)
    return torch.cat([knots.turn, eye], dim=2), torch.cat([place, world], dim=2)


def _incidence(body: Tensor, bodies: int) -> Tensor:
    """(n, bodies) matrix: 1 for an item that belongs to a body; the world has none."""
    return (torch.arange(bodies) == body[:, None]).float()


def _tensor(values: object) -> Tensor:
    return torch.as_tensor(np.asarray(values, dtype=np.float32))


def _index(values: object) -> Tensor:
    return torch.as_tensor(np.asarray(values, dtype=np.int64))
