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

from flywheel.dynamics.residual.config import ResidualConfig
from flywheel.dynamics.residual.features import (
    BODY_FEATURES,
    CABLE_FEATURES,
    ERROR,
    POINT_FEATURES,
    Layout,
    Shown,
    features,
)
from flywheel.dynamics.residual.mechanics import FREEDOMS, Structure, structure_of
from flywheel.dynamics.residual.motion import Knots
from flywheel.robots import Robot

DRIFT = 0.02  # typical of the velocity of an error, and of rates of rest lengths [sqrt(L g)]
FORCE = 0.02  # typical of what the network adds to forces [weight], and to torques [weight L]
_LEAST_SPREAD = 1e-4  # below which a feature is constant


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
        drives, structure = self._drives(shown), structure_of(layout, shown)
        h = self.config.interval
        error = velocity = hidden.new_zeros(batch, layout.bodies, 2, 3)
        longer = hidden.new_zeros(batch, len(layout.stiffness))
        found = []
        for k in range(ahead.place.shape[1]):
            turn = shown.turn[:, k]
            off = _off(turn, structure, k, error, velocity, longer)
            hidden, said = self._update(hidden, drives, k, off)
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
