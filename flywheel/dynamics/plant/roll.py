"""The roll of a rod, its turn about its own axis: unseen, but its cables, which end on its surface, tell it.

A rod has little inertia about its axis and its cables are stiff, so it soon comes to rest where their
elastic energy is least. That turn is found by trying angles, finer and finer, body after body.
"""

from __future__ import annotations

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.rotations import about_axis, multiply, rotate

ANGLES = 48  # tried per body
ROUNDS = 4  # each of them NARROWING times as wide as the one before
NARROWING = 0.15
SWEEPS = 3  # over all bodies, per round
ON_A_LINE = 1e-6  # singular value over the largest, below which points are collinear


def unseen_axes(robot: Robot) -> dict[int, Floats]:
    """Body -> (3,) unit axis in its frame, about which no tracked point tells how far it is turned."""
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
    """Poses turned about their bodies' axes to where the cables' elastic energy is least.

    Args:
      robot: whose cables pull.
      poses: (B, bodies, 7) positions [m] and quaternions.
      winch: (B, W) winch positions [m].
      axes: body -> (3,) unit axis in its frame, of the bodies that may turn.
      rounds: of the search.

    Returns:
      (B, bodies, 7) poses.
    """
    poses, rest = poses.copy(), rest_lengths(robot, winch)
    width = np.pi
    for _ in range(rounds):
        angles = np.linspace(-width, width, ANGLES, endpoint=False)
        for _ in range(SWEEPS):
            for body, axis in axes.items():
                turn = poses[:, body, 3:]
                about = about_axis(rotate(turn, axis)[:, None], angles[None])
                turns = multiply(about, turn[:, None])
                best = _energy(robot, poses, rest, body, turns).argmin(axis=1)
                poses[:, body, 3:] = turns[np.arange(len(turns)), best]
        width *= NARROWING
    return poses


def rest_lengths(robot: Robot, winch: Floats) -> Floats:
    """Rest lengths (..., cables) [m] at winch positions (..., W) [m]."""
    nominal = np.array([robot.cables[w.cables[0]].rest_length for w in robot.winches])
    paid_out = np.concatenate([winch - nominal, np.zeros_like(winch[..., :1])], axis=-1)
    driven_by = [cable.winch for cable in robot.cables]  # -1, passive: the zero at the end
    return np.array([cable.rest_length for cable in robot.cables]) + paid_out[..., driven_by]


def _energy(robot: Robot, poses: Floats, rest: Floats, body: int, turns: Floats) -> Floats:
    """(B, angles) elastic energy [J] of a body's cables if it were turned as `turns` (B, angles, 4)."""
    energy = np.zeros(turns.shape[:2])
    for index, cable in enumerate(robot.cables):
        for here, there in (cable.ends, cable.ends[::-1]):
            if here.body != body:
                continue
            end = poses[:, None, body, :3] + rotate(turns, here.offset)
            other = np.broadcast_to(there.offset, (len(poses), 3))
            if there.body >= 0:
                pose = poses[:, there.body]
                other = pose[:, :3] + rotate(pose[:, 3:], there.offset)
            length = np.linalg.norm(end - other[:, None], axis=-1)
            energy += cable.stiffness / 2 * np.maximum(length - rest[:, index, None], 0) ** 2
    return energy
