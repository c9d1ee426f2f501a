"""Attachments of cables guessed from the tracked points alone, without the MJCF's."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from flywheel.dynamics.plant.roll import line_of
from flywheel.records import Floats
from flywheel.robots import Attachment, Robot
from flywheel.rotations import about_axis, conjugate, rotate, unit

AttachmentGuess = Literal["mjcf", "heuristic", "uninformed"]
"""The MJCF's; places on the end caps' circles, found in the keyframe; the tracked points themselves."""

_UPRIGHT = 1e-6  # length across its axis that the vertical has at least, unless a rod stands


def with_attachments(robot: Robot, guess: AttachmentGuess, calibrated: bool = True) -> Robot:
    """The robot with guessed ends of its cables on bodies; those in the world stay.

    A heuristic end lies on the circle of its end cap across the rod's axis. The circle has as many
    places as the cap has cables to other caps, evenly from the highest one on; they are matched with
    the other caps so that the distances to these are least together. A tracked point without a
    contact sphere, or on a body that is no rod, is an end itself.

    Args:
      robot: with the MJCF's attachments.
      guess: of others.
      calibrated: rest lengths are shifted so that in the keyframe each cable is stretched as the MJCF's
        is; see `winch_offsets`.
    """
    if guess == "mjcf":
        return robot
    circles = _circles(robot) if guess == "heuristic" else {}

    def end(here: Attachment, there: Attachment) -> Attachment:
        if here.body < 0:
            return here
        point = robot.points[here.point]
        return replace(here, offset=circles.get((here.point, _partner(there)), point.offset))

    cables = [
        replace(cable, ends=(end(*cable.ends), end(*cable.ends[::-1]))) for cable in robot.cables
    ]
    if calibrated:
        poses = robot.keyframe.qpos.reshape(1, -1, 7)
        longer = replace(robot, cables=tuple(cables)).cable_lengths(poses)
        longer = (longer - robot.cable_lengths(poses))[0]
        rest = [cable.rest_length + float(x) for cable, x in zip(cables, longer, strict=True)]
        cables = [replace(c, rest_length=length) for c, length in zip(cables, rest, strict=True)]
    return replace(robot, cables=tuple(cables))


def winch_offsets(robot: Robot, guessed: Robot) -> Floats:
    """(W,) positions of the winches of a guess beyond the robot's [m]."""
    first = [winch.cables[0] for winch in robot.winches]
    return np.array([guessed.cables[i].rest_length - robot.cables[i].rest_length for i in first])


def _circles(robot: Robot) -> dict[tuple[int, object], Floats]:
    """(Tracked point, partner) -> (3,) place on the circle, in the body's frame [m]."""
    seen = robot.points_of(robot.keyframe)
    partners: dict[int, dict[object, Floats]] = {}
    for cable in robot.cables:
        for here, there in (cable.ends, cable.ends[::-1]):
            if here.body >= 0:
                place = seen[there.point] if there.body >= 0 else there.offset
                partners.setdefault(here.point, {})[_partner(there)] = place
    found: dict[tuple[int, object], Floats] = {}
    for index, others in partners.items():
        point = robot.points[index]
        line = line_of(robot.offsets_of(robot.bodies[point.body]))
        if line is None or not point.radius:
            continue
        turn = robot.keyframe.qpos.reshape(-1, 7)[point.body, 3:]
        axis = rotate(turn, line)
        angles = np.arange(len(others)) * 2.0 * np.pi / len(others)
        places = point.radius * rotate(about_axis(axis, angles), _highest(axis))
        apart = np.array(list(others.values()))[:, None] - (seen[index] + places)
        rows, columns = linear_sum_assignment(np.linalg.norm(apart, axis=-1))
        names = list(others)
        for row, column in zip(rows, columns, strict=True):
            found[index, names[row]] = point.offset + rotate(conjugate(turn), places[column])
    return found


def _partner(end: Attachment) -> object:
    """Identity of a cable's other end: its tracked point, or its place in the world."""
    return end.point if end.body >= 0 else tuple(end.offset)


def _highest(axis: Floats) -> Floats:
    """(3,) unit vector across an axis that points up as far as it can."""
    up = np.array([0.0, 0.0, 1.0])
    if np.linalg.norm(np.cross(axis, up)) < _UPRIGHT:
        up = np.array([1.0, 0.0, 0.0])
    return unit(up - (up @ axis) * axis)
