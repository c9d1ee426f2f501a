"""Growth and decay of an error of a plant's motion: its mechanics, linearised along the motion.

Bodies are displaced by small twists q from their poses in the plant, at velocities v. Over an
interval h

    (M + h D + h^2 K) v' = M v + h f(q),    q' = q + h v',

with the bodies' inertia M, the stiffness K and the damping D of taut cables and of contacts, all in
the plant's pose at that instant, and forces f: those of cables whose length differs from the
plant's, and those added by the network. The step is implicit, so stiff cables and contacts need no
short ones. Without errors and added forces, everything stays exactly zero.

All numbers are in the robot's units: its length L, sqrt(L / g), and its weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flywheel.dynamics.residual.features import Layout, Shown

FREEDOMS = 6  # of a body: a translation and a turn, both in the world
TOUCH, EDGE = (
    0.003,
    0.002,
)  # height below which a point is in contact, and how sharply that begins [L]
NORMAL_STIFFNESS, NORMAL_DAMPING = 200.0, 5.0  # of a contact [weight / L], [weight / sqrt(L g)]
STICKING, SLIDING = (
    20.0,
    0.05,
)  # tangential damping at rest, and the speed at which half of it is left


@dataclass(frozen=True)
class Structure:
    """The plant's mechanics at all knots; n is the number of freedoms of all bodies.

    Attributes:
      mass: (B, K, n, n).
      elongation: (B, K, C, n) of the cables, per displacement.
      rise: (B, K, P, n) of the contact places of tracked points, likewise.
      strain: (B, K, C) length beyond the rest length; negative where slack [L].
      stiffness: (C,) of the cables.
      geometric: (B, K, n, n) stiffness from the tensions and from contacts.
      damping: (B, K, n, n).
    """

    mass: Tensor
    elongation: Tensor
    rise: Tensor
    strain: Tensor
    stiffness: Tensor
    geometric: Tensor
    damping: Tensor

    def step(
        self, k: int, h: float, error: Tensor, velocity: Tensor, longer: Tensor, force: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Errors (B, n) and their velocities one interval later, in the pose at knot k.

        Args:
          k: knot.
          h: interval.
          error, velocity: (B, n) before.
          longer: (B, C) excess of rest lengths over the plant's.
          force: (B, n) added.
        """
        per, strain = self.elongation[:, k], self.strain[:, k]
        stretch = strain + torch.einsum("bcn,bn->bc", per, error) - longer
        taut = self.stiffness * (stretch > 0)
        tension = taut * stretch - self.stiffness * strain.clamp(min=0.0)
        stiffness = torch.matmul((per * taut[..., None]).transpose(1, 2), per)
        stiffness = stiffness + self.geometric[:, k]
        pull = torch.einsum("bcn,bc->bn", per, tension)
        pull = pull + torch.einsum("bnm,bm->bn", self.geometric[:, k], error)
        left = self.mass[:, k] + h * self.damping[:, k] + h * h * stiffness
        right = torch.einsum("bnm,bm->bn", self.mass[:, k], velocity) + h * (force - pull)
        velocity = torch.linalg.solve(left, right)
        return error + h * velocity, velocity


def structure_of(layout: Layout, shown: Shown) -> Structure:
    """The plant's mechanics at all knots; of the two ends of each cable, the first one comes first."""
    one, other = slice(0, None, 2), slice(1, None, 2)
    first, second = layout.owns[one], layout.owns[other]
    arms = shown.arms[:, :, one], shown.arms[:, :, other]
    along, length, strain = (x[:, :, one] for x in (shown.along, shown.length, shown.strain))
    stiffness = layout.stiffness
    apart = _moves(second, arms[1]) - _moves(first, arms[0])  # (B, K, C, 3, n)
    per = torch.einsum("bkci,bkcin->bkcn", along, apart)
    tension = stiffness * strain.clamp(min=0.0)
    across = apart - along[..., None] * per[..., None, :]
    geometric = _squared(across.flatten(2, 3), (tension / length).repeat_interleave(3, dim=-1))
    geometric = geometric + _levers(first, second, arms, along * tension[..., None])
    touching = torch.sigmoid((TOUCH - shown.height) / EDGE)
    moves = _moves(layout.carries, shown.point_arms + layout.below)
    up, level = moves[..., 2, :], moves[..., :2, :].flatten(2, 3)
    sliding = shown.touch_speed[..., :2].norm(dim=-1)
    sticking = touching * STICKING / (1.0 + sliding / SLIDING)
    geometric = geometric + _squared(up, NORMAL_STIFFNESS * touching)
    lost = _squared(per, layout.damping.expand_as(strain))
    lost = lost + _squared(up, NORMAL_DAMPING * touching)
    lost = lost + _squared(level, sticking.repeat_interleave(2, dim=-1))
    mass = _mass(shown.turn, layout.masses, layout.inertias)
    return Structure(mass, per, up, strain, stiffness, geometric, lost)


def _mass(turn: Tensor, masses: Tensor, inertias: Tensor) -> Tensor:
    """(B, K, n, n) inertia of all bodies."""
    batch, steps, bodies = turn.shape[:3]
    blocks = turn.new_zeros(batch, steps, bodies, FREEDOMS, FREEDOMS)
    blocks[..., :3, :3] = masses[:, None, None] * torch.eye(3)
    blocks[..., 3:, 3:] = torch.einsum("bknij,nj,bknlj->bknil", turn, inertias, turn)
    return _placed(blocks)


def _levers(first: Tensor, second: Tensor, arms: tuple[Tensor, Tensor], pull: Tensor) -> Tensor:
    """(B, K, n, n) stiffness of rotating bodies under constant forces; `pull` is on the first ends."""
    blocks = torch.einsum("cn,bkcij->bknij", first, _cross(pull) @ _cross(arms[0]))
    blocks = blocks - torch.einsum("cn,bkcij->bknij", second, _cross(pull) @ _cross(arms[1]))
    whole = pull.new_zeros(*blocks.shape[:3], FREEDOMS, FREEDOMS)
    whole[..., 3:, 3:] = -blocks
    return _placed(whole)


def _placed(blocks: Tensor) -> Tensor:
    """(B, K, n, n) with blocks (B, K, bodies, 6, 6) on the diagonal."""
    bodies = blocks.shape[2]
    whole = torch.einsum("bknij,nm->bknimj", blocks, torch.eye(bodies))
    return whole.flatten(4, 5).flatten(2, 3)


def _moves(carriers: Tensor, arms: Tensor) -> Tensor:
    """(B, K, m, 3, n) motion of places at arms (B, K, m, 3) with the bodies (m, bodies) that carry them."""
    eye = torch.eye(3).expand(*arms.shape[:-1], 3, 3)
    own = torch.cat([eye, -_cross(arms)], dim=-1)
    return torch.einsum("bkmij,mn->bkminj", own, carriers).flatten(-2)


def _squared(rows: Tensor, weights: Tensor) -> Tensor:
    """(B, K, n, n) sums of weights (B, K, m) times the squares of rows (B, K, m, n)."""
    return torch.matmul((rows * weights[..., None]).transpose(-1, -2), rows)


def _cross(vectors: Tensor) -> Tensor:
    """Matrices (..., 3, 3) that take a vector x to v cross x."""
    x, y, z = vectors.unbind(-1)
    zero = torch.zeros_like(x)
    rows = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
