"""Poses of bodies from their tracked points."""

from __future__ import annotations

import numpy as np

from flywheel.dynamics.plant.roll import line_of
from flywheel.records import Floats
from flywheel.robots import Body, Robot
from flywheel.rotations import kabsch, multiply, rotate, shortest

FREE_POSITIONS = 7


def seen_poses(robot: Robot, points: Floats) -> Floats:
    """(B, bodies, 7) positions [m] and quaternions of the bodies whose points are at (B, P, 3) [m].

    Undetermined rotations stay as in the keyframe, with the smallest rotation from there.
    """
    turns = [_turn(robot, i, body, points) for i, body in enumerate(robot.bodies)]
    return at_points(robot, np.stack(turns, axis=1), points)


def at_points(robot: Robot, turns: Floats, points: Floats) -> Floats:
    """(B, bodies, 7) poses with quaternions (B, bodies, 4), where the bodies' points are at (B, P, 3) [m]."""
    each = []
    for index, body in enumerate(robot.bodies):
        center = robot.offsets_of(body).mean(axis=0)
        seen_center = points[:, list(body.points)].mean(axis=1)
        each.append(seen_center - rotate(turns[:, index], center))
    return np.concatenate([np.stack(each, axis=1), turns], axis=2)


def _turn(robot: Robot, index: int, body: Body, points: Floats) -> Floats:
    """(B, 4) quaternions of one body; points (B, P, 3) are those of all."""
    own = points[:, list(body.points)]
    joint = slice(FREE_POSITIONS * index + 3, FREE_POSITIONS * (index + 1))
    seen = own - own.mean(axis=1)[:, None]
    return _orientation(robot.offsets_of(body), seen, robot.keyframe.qpos[joint])


def _orientation(offsets: Floats, seen: Floats, reference: Floats) -> Floats:
    """(B, 4) rotation that takes offsets (n, 3) onto centred points (B, n, 3).

    Undetermined rotations stay as in the `reference` (4,).
    """
    here = offsets - offsets.mean(axis=0)
    if not here.any():
        return np.broadcast_to(reference, (len(seen), 4))
    axis = line_of(offsets)
    if axis is None:
        return kabsch(here, seen)
    seen_axis = ((here @ axis)[:, None] * seen).sum(axis=1)
    return multiply(shortest(rotate(reference, axis), seen_axis), reference)
