"""The network that corrects a plant's motion: bodies are nodes, cables are edges.

It runs along the plant's motion from knot to knot. Each body has a hidden state and an error state:
its displacement and rotation from its pose in the plant, and their rates. At each knot bodies get
messages from their cables and their tracked points and update their hidden states. The network then
predicts the error of each cable's rest length, an additional tension of the cable, and an
additional force and torque on a body. The rest is mechanics, which need not be learned
(`mechanics`).

All vectors are inputs and outputs in the frame of the body itself, in the plant's motion. The
result is therefore independent of the robot's position, its rotation about the vertical, and the
order of its bodies and cables. The last layers start at zero: an untrained network corrects
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from flywheel.dynamics.gnn.nodes import standardised
from flywheel.dynamics.residual.config import ResidualConfig
from flywheel.dynamics.residual.mechanics import FREEDOMS, Structure, structure_of
from flywheel.dynamics.residual.motion import Knots, Units
from flywheel.effects import Scales
from flywheel.robots import Attachment, Robot

ERROR = 0.01  # typical of an error state, and of what the network corrects it by at the present [L, rad]
DRIFT = 0.02  # typical of its velocity, and of what the network says of rates of rest lengths [sqrt(L g)]
FORCE = 0.02  # typical of what the network adds to forces [weight], and to torques [weight L]
_LEAST_INERTIA = 1e-5  # of a body [robot's mass, L^2]
_NEAR = 10.0  # how sharply being near the ground is shown, per clearance
_LEAST_SPREAD = 1e-4  # below which a feature is constant
CABLE_FEATURES, POINT_FEATURES, BODY_FEATURES = 18, 13, 20


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
        rows = [
            [
                np.log(max(c.stiffness * L / weight, 1e-6)),
                np.log(max(c.damping * self.units.speed / weight, 1e-6)),
                ratio,
            ]
            for c, ratio in zip(robot.cables, robot.ratios, strict=True)
        ]
        self.cable_constants = _tensor(standardised(np.array(rows)))[self.cable]
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


Drives = tuple[tuple[Tensor, ...], tuple[Tensor, ...], tuple[Tensor, ...]]
"""Contribution of features to the messages of cables, points and bodies at each knot."""


class ResidualNetwork(nn.Module):
    """The weights.

    Args:
      robot: of the corrected plant.
      config: shape.

    Attributes:
      cable_scale, point_scale, body_scale: (2, F) mean and spread of the features, from training data.
    """

    cable_scale: Tensor
    point_scale: Tensor
    body_scale: Tensor

    def __init__(self, robot: Robot, config: ResidualConfig) -> None:
        super().__init__()
        self.robot_digest, self.config, self.layout = robot.digest, config, Layout(robot)
        width = config.width
        for name, count in (
            ("cable", CABLE_FEATURES),
            ("point", POINT_FEATURES),
            ("body", BODY_FEATURES),
        ):
            self.register_buffer(
                f"{name}_scale", torch.stack([torch.zeros(count), torch.ones(count)])
            )
        self.cable_in = nn.Linear(CABLE_FEATURES, width)
        self.point_in = nn.Linear(POINT_FEATURES, width)
        self.body_in = nn.Linear(BODY_FEATURES, width)
        self.cable_hidden = nn.Linear(width, 2 * width, bias=False)  # as its own end, as the other
        self.point_hidden = nn.Linear(width, width, bias=False)
        self.cable_error = nn.Linear(3, width, bias=False)
        self.point_error = nn.Linear(2, width, bias=False)
        self.mix = nn.Linear(3 * width + 2 * FREEDOMS, width)
        self.memory = nn.GRUCell(width, width)
        self.present = _decoder(width, 2 * FREEDOMS)  # error and velocity at the present
        self.wrench = _decoder(width, FREEDOMS)
        self.cable = _decoder(width, 3)  # rest length at the present, its rate, tension

    @torch.no_grad()
    def fit_scales(self, past: Knots | None, ahead: Knots) -> None:
        """Take mean and spread of the features from the motions of training data."""
        shown = [features(self.layout, self.config, ahead, past=False)]
        if past is not None:
            shown.append(features(self.layout, self.config, past, past=True))
        for scale, kinds in (
            (self.cable_scale, [s.cables for s in shown]),
            (self.point_scale, [s.points for s in shown]),
            (self.body_scale, [s.bodies for s in shown]),
        ):
            rows = torch.cat([kind.flatten(0, 2) for kind in kinds]).double()
            spread = rows.std(dim=0)
            spread = torch.where(spread > _LEAST_SPREAD, spread, torch.ones_like(spread))
            scale.copy_(torch.stack([rows.mean(dim=0), spread]))

    def forward(self, past: Knots | None, ahead: Knots) -> tuple[Tensor, Tensor]:
        """Corrections at the knots of a motion.

        Args:
          past: (B or 1) the motion up to the present; None for none.
          ahead: (B) the motion from the present on.

        Returns:
          (B, K, bodies, 3) translations of centres of mass [L] and (B, K, bodies, 3) turns [rad], in the
          world.
        """
        batch, layout = len(ahead), self.layout
        hidden = self._remembered(past, ahead)
        hidden = hidden.expand(batch, -1, -1) if len(hidden) == 1 else hidden
        shown = features(layout, self.config, ahead, past=False)
        drives, structure = self._drives(shown), _structure(layout, shown)
        h = self.config.interval
        error = velocity = hidden.new_zeros(batch, layout.bodies, 2, 3)
        longer = hidden.new_zeros(batch, len(layout.stiffness))
        found = []
        for k in range(ahead.place.shape[1]):
            off = _off(layout, shown.turn[:, k], structure, k, error, velocity, longer)
            hidden, said = self._update(hidden, drives, k, off)
            turn = shown.turn[:, k]
            rest, rate, tension = said.unbind(-1)
            if k == 0:
                both = self.present(hidden).view(batch, layout.bodies, 2, 2, 3)
                error, velocity = (
                    size * _out_of(turn, both[:, :, i]) for i, size in ((0, ERROR), (1, DRIFT))
                )
                longer = ERROR * rest
            else:
                longer = longer + h * DRIFT * rate
                wrench = _out_of(turn, self.wrench(hidden).view(batch, layout.bodies, 2, 3))
                force = FORCE * (
                    wrench.flatten(1)
                    - torch.einsum("bcn,bc->bn", structure.elongation[:, k], tension)
                )
                error, velocity = (
                    each.view(batch, layout.bodies, 2, 3)
                    for each in structure.step(
                        k, h, error.flatten(1), velocity.flatten(1), longer, force
                    )
                )
            found.append(error)
        errors = torch.stack(found, dim=1)
        return errors[..., 0, :], errors[..., 1, :]

    def _remembered(self, past: Knots | None, ahead: Knots) -> Tensor:
        """(B or 1, bodies, width) hidden states at the present."""
        shape = (1 if past is None else len(past), self.layout.bodies, self.config.width)
        hidden = ahead.place.new_zeros(shape)
        if past is not None:
            drives = self._drives(features(self.layout, self.config, past, past=True))
            for k in range(past.place.shape[1]):
                hidden, _ = self._update(hidden, drives, k, None)
        return hidden

    def _drives(self, shown: Shown) -> Drives:
        """Contribution of features to the messages of all knots at once."""

        def scaled(values: Tensor, scale: Tensor) -> Tensor:
            return (values - scale[0]) / scale[1]

        return (
            self.cable_in(scaled(shown.cables, self.cable_scale)).unbind(1),
            self.point_in(scaled(shown.points, self.point_scale)).unbind(1),
            self.body_in(scaled(shown.bodies, self.body_scale)).unbind(1),
        )

    def _update(
        self, hidden: Tensor, drives: Drives, k: int, off: Off | None
    ) -> tuple[Tensor, Tensor]:
        """Hidden states (B, bodies, width) after knot k, and outputs for the cables (B, C, 3).

        Args:
          off: errors relative to the plant's motion; None for zero.
        """
        layout = self.layout
        own, other = self.cable_hidden(hidden).chunk(2, dim=-1)
        cables = drives[0][k] + torch.matmul(layout.owns, own) + torch.matmul(layout.others, other)
        points = drives[1][k] + torch.matmul(layout.carries, self.point_hidden(hidden))
        bodies = hidden.new_zeros(*hidden.shape[:2], 2 * FREEDOMS) if off is None else off.bodies
        if off is not None:
            cables = cables + self.cable_error(off.cables).repeat_interleave(2, dim=1)
            points = points + self.point_error(off.points)
        cables = torch.relu(cables)
        received = torch.cat(
            [
                torch.matmul(layout.owns.t(), cables),
                torch.matmul(layout.carries.t(), torch.relu(points)),
                torch.relu(drives[2][k]),
                bodies,
            ],
            dim=-1,
        )
        mixed = torch.relu(self.mix(received))
        after = self.memory(mixed.flatten(0, 1), hidden.flatten(0, 1)).view_as(hidden)
        return after, self.cable(cables.unflatten(1, (-1, 2)).sum(2))


@dataclass(frozen=True)
class Off:
    """Errors relative to the plant's motion, as network inputs.

    Attributes:
      cables: (B, C, 3) excess length of a cable, its rate, and the excess of its rest length.
      points: (B, P, 2) excess height of a tracked point, and its rate.
      bodies: (B, bodies, 12) error and velocity of a body, in its frame.
    """

    cables: Tensor
    points: Tensor
    bodies: Tensor


def _off(
    layout: Layout,
    turn: Tensor,
    structure: Structure,
    k: int,
    error: Tensor,
    velocity: Tensor,
    longer: Tensor,
) -> Off:
    """Errors as network inputs, from error states (B, bodies, 2, 3) and rest lengths (B, C)."""
    both = torch.stack([error / ERROR, velocity / DRIFT], dim=2)  # (B, bodies, 2, 2, 3)
    states = both.transpose(1, 2).flatten(2).transpose(1, 2)  # (B, n, 2)
    cables = torch.cat(
        [torch.matmul(structure.elongation[:, k], states), longer[..., None] / ERROR], -1
    )
    bodies = torch.einsum("bnji,bnstj->bnsti", turn, both).flatten(2)
    points = torch.matmul(structure.rise[:, k], states)
    return Off(torch.asinh(cables), torch.asinh(points), torch.asinh(bodies))


def _decoder(width: int, outputs: int) -> nn.Sequential:
    """Two layers, the last of which starts at zero."""
    last = nn.Linear(width, outputs)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(width, width), nn.ReLU(), last)


def _structure(layout: Layout, shown: Shown) -> Structure:
    """The plant's mechanics; of the two ends of each cable, the first one comes first."""
    first, second = slice(0, None, 2), slice(1, None, 2)
    return structure_of(
        turn=shown.turn,
        masses=layout.masses,
        inertias=layout.inertias,
        first=layout.owns[first],
        second=layout.owns[second],
        arms=(shown.arms[:, :, first], shown.arms[:, :, second]),
        along=shown.along[:, :, first],
        length=shown.length[:, :, first],
        strain=shown.strain[:, :, first],
        stiffness=layout.stiffness,
        damping=layout.damping,
        carries=layout.carries,
        touch_arms=shown.point_arms + layout.below,
        height=shown.height,
        speed=shown.touch_speed,
    )


def _out_of(turn: Tensor, twists: Tensor) -> Tensor:
    """Twists (B, bodies, 2, 3) of body frames that are turned by (B, bodies, 3, 3), in the world."""
    return torch.einsum("bnij,bnsj->bnsi", turn, twists)


def displaced(arms: Tensor, shift: Tensor, turn: Tensor) -> Tensor:
    """(..., 3) motion of places at arms (..., 3) when their body is shifted and rotated by (..., 3)
    [rad].
    """
    angle = turn.norm(dim=-1, keepdim=True) / np.pi
    once = torch.linalg.cross(turn, arms)
    twice = torch.linalg.cross(turn, once)
    return shift + torch.sinc(angle) * once + 0.5 * torch.sinc(angle / 2) ** 2 * twice


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
