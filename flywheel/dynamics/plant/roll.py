"""The roll of a rod, its rotation about its own axis: invisible, but determined by the cables on
its surface.

A rod has little inertia about its axis and its cables are stiff, so it soon rests where their
elastic energy is least. That rotation is found by testing angles, finer and finer, body after body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.rotations import about_axis, cross, multiply, rotate

ANGLES = 48  # tried per body
ROUNDS = 4  # each of them NARROWING times as wide as the one before
NARROWING = 0.15
SWEEPS = 3  # over all bodies, per round
ON_A_LINE = 1e-6  # singular value over the largest, below which points are collinear


def unseen_axes(robot: Robot) -> dict[int, Floats]:
    """Body -> (3,) unit axis in its frame, about which its tracked points do not determine its rotation."""
    lines = {}
    for index, body in enumerate(robot.bodies):
        line = line_of(robot.offsets_of(body))
        if line is not None:
            lines[index] = line
    return lines


def line_of(offsets: Floats) -> Floats | None:
    """(3,) direction of the line through points (n, 3); None if they coincide or are not collinear."""
    _, spread, directions = np.linalg.svd(offsets - offsets.mean(axis=0))
    spread = np.concatenate([spread, np.zeros(2)])
    on_one_line = spread[0] > 0 and spread[1] <= ON_A_LINE * spread[0]
    return directions[0] if on_one_line else None


def relaxed(
    robot: Robot, poses: Floats, winch: Floats, axes: dict[int, Floats], rounds: int = ROUNDS
) -> Floats:
    """Poses with bodies rotated about their axes to the least elastic energy of the cables.

    Args:
      robot: of the cables.
      poses: (B, bodies, 7) positions [m] and quaternions.
      winch: (B, W) winch positions [m].
      axes: body -> (3,) unit axis in its frame, of the bodies that may turn.
      rounds: of the search.

    Returns:
      (B, bodies, 7) poses.
    """
    poses, rest, width = poses.copy(), rest_lengths(robot, winch), np.pi
    told = robot.told_tensions(winch)
    pulled = {end.body for cable in robot.cables for end in cable.ends}
    circles = {body: _Circles.of(robot, body, axes[body]) for body in axes if body in pulled}
    for _ in range(rounds):
        angles = np.linspace(-width, width, ANGLES, endpoint=False)
        for _ in range(SWEEPS):
            for body, ends in circles.items():
                best = angles[ends.energy(poses, rest, told, angles).argmin(axis=1)]
                turn = poses[:, body, 3:]
                poses[:, body, 3:] = multiply(about_axis(rotate(turn, axes[body]), best), turn)
        width *= NARROWING
    return poses


def rest_lengths(robot: Robot, winch: Floats) -> Floats:
    """Rest lengths (..., cables) [m] at winch positions (..., W) [m]; 0 where winches take tensions."""
    nominal = np.array([robot.cables[w.cables[0]].rest_length for w in robot.winches])
    paid_out = np.zeros((*winch.shape[:-1], len(robot.winches) + 1))
    if not robot.tension_driven:
        paid_out[..., :-1] = winch - nominal
    driven_by = [cable.winch for cable in robot.cables]  # -1, passive: the zero at the end
    kept = np.array([cable.rest_length for cable in robot.cables])
    return kept + robot.ratios * paid_out[..., driven_by]


@dataclass(frozen=True)
class _Circles:
    """Circles of the cable ends on a body that rotates about an axis; n ends.

    Attributes:
      body: its index.
      centre, radius, across: (n, 3) in the body's frame: an end is at centre + radius cos + across
        sin [m].
      cables: (n,) of the ends.
      stiffness: (n,) of these [N/m].
      others: (n,) bodies of the opposite ends; -1 for an anchor.
      offsets: (n, 3) of the opposite ends on these [m].
    """

    body: int
    centre: Floats
    radius: Floats
    across: Floats
    cables: np.ndarray
    stiffness: Floats
    others: np.ndarray
    offsets: Floats

    @classmethod
    def of(cls, robot: Robot, body: int, axis: Floats) -> Self:
        """Of the cables of a body that turns about a unit axis (3,)."""
        ends = [
            (here.offset, index, cable.stiffness, there.body, there.offset)
            for index, cable in enumerate(robot.cables)
            for here, there in (cable.ends, cable.ends[::-1])
            if here.body == body
        ]
        offsets, cables, stiffness, others, opposite = zip(*ends, strict=True)
        centre = np.outer(np.array(offsets) @ axis, axis)
        radius = np.array(offsets) - centre
        return cls(
            body,
            centre,
            radius,
            cross(axis, radius),
            np.array(cables),
            np.array(stiffness),
            np.array(others),
            np.array(opposite),
        )

    def energy(self, poses: Floats, rest: Floats, told: Floats, angles: Floats) -> Floats:
        """(B, angles) elastic energy [J] of the cables for a body rotated by these angles.

        Args:
          poses: (B, bodies, 7) of all bodies.
          rest: (B, cables) rest lengths [m].
          told: (B, cables) tensions that winches are told [N].
          angles: [rad].
        """
        held = poses[:, self.others]
        opposite = held[..., :3] + rotate(held[..., 3:], self.offsets)
        opposite = np.where(self.others[:, None] >= 0, opposite, self.offsets)
        own = poses[:, None, self.body]
        vectors = np.stack([self.centre, self.radius, self.across])
        centre, radius, across = rotate(own[:, None, :, 3:], vectors).swapaxes(0, 1)
        off = own[..., :3] + centre - opposite  # (B, n, 3)
        fixed = ((off**2).sum(axis=-1) + (radius**2).sum(axis=-1))[..., None]
        by_cos, by_sin = (2 * (off * each).sum(axis=-1)[..., None] for each in (radius, across))
        square = fixed + by_cos * np.cos(angles) + by_sin * np.sin(angles)
        length = np.sqrt(np.maximum(square, 0.0))
        stretch = np.maximum(length - rest[:, self.cables, None], 0.0)
        stored = self.stiffness[:, None] / 2 * stretch**2
        if told.any():
            stored = stored + told[:, self.cables, None] * length
        return np.asarray(stored.sum(axis=1))
