"""Poses of bodies from their tracked points, and lengths of cables from poses."""

from __future__ import annotations

import numpy as np

from flywheel.dynamics.plant.roll import line_of
from flywheel.records import Floats
from flywheel.robots import Attachment, Body, Robot
from flywheel.rotations import kabsch, multiply, rotate, shortest

FREE_POSITIONS = 7


def seen_poses(robot: Robot, points: Floats) -> Floats:
    """(B, bodies, 7) positions [m] and quaternions of the bodies whose points are at (B, P, 3) [m].

    What the points leave open is as in the keyframe, with the least turn from there.
    """
    each = [_pose(robot, i, body, points) for i, body in enumerate(robot.bodies)]
    return np.stack(each, axis=1)


def at_points(robot: Robot, poses: Floats, points: Floats) -> Floats:
    """Poses (B, bodies, 7), moved without a turn to where the bodies' points are, at (B, P, 3) [m].

    A turn about a line moves points that are not on it: markers that do not sit on the axis of their rod.
    """
    moved = poses.copy()
    for index, body in enumerate(robot.bodies):
        center = robot.offsets_of(body).mean(axis=0)
        seen = points[:, list(body.points)].mean(axis=1)
        moved[:, index, :3] = seen - rotate(poses[:, index, 3:], center)
    return moved


def cable_lengths(robot: Robot, poses: Floats) -> Floats:
    """(B, C) lengths of the cables between bodies at poses (B, bodies, 7) [m]."""
    ends = [[_place(poses, end) for end in cable.ends] for cable in robot.cables]
    return np.stack([np.linalg.norm(a - b, axis=-1) for a, b in ends], axis=1)


def _place(poses: Floats, end: Attachment) -> Floats:
    """(B, 3) of a cable's end [m]."""
    if end.body < 0:
        return np.broadcast_to(end.offset, (len(poses), 3))
    pose = poses[:, end.body]
    return np.asarray(pose[:, :3] + rotate(pose[:, 3:], end.offset))


def _pose(robot: Robot, index: int, body: Body, points: Floats) -> Floats:
    """(B, 7) of one body; points (B, P, 3) are those of all."""
    own, offsets = points[:, list(body.points)], robot.offsets_of(body)
    center, seen_center = offsets.mean(axis=0), own.mean(axis=1)
    joint = slice(FREE_POSITIONS * index + 3, FREE_POSITIONS * (index + 1))
    turn = _orientation(offsets, own - seen_center[:, None], robot.keyframe.qpos[joint])
    return np.concatenate([seen_center - rotate(turn, center), turn], axis=1)


def _orientation(offsets: Floats, seen: Floats, reference: Floats) -> Floats:
    """(B, 4) rotation that takes offsets (n, 3) onto centred points (B, n, 3).

    What the points leave open is as in the `reference` (4,).
    """
    here = offsets - offsets.mean(axis=0)
    if not here.any():
        return np.broadcast_to(reference, (len(seen), 4))
    axis = line_of(offsets)
    if axis is None:
        return kabsch(here, seen)
    seen_axis = ((here @ axis)[:, None] * seen).sum(axis=1)
    return multiply(shortest(rotate(reference, axis), seen_axis), reference)
