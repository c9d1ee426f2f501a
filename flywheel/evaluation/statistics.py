"""Statistics: one number per sample, lead time and body, between measured and predicted points.

Every statistic has one signature, `(robot, truth, predicted) -> values`, with points (..., P, 3)
[m]. A missing (NaN) truth gives NaN, so that it gets no weight. A prediction is never missing.
"""

from __future__ import annotations

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Body, Robot


def squared_position_error(robot: Robot, truth: Floats, predicted: Floats) -> Floats:
    """Squared distance between the centres of mass of each body: (..., bodies) [m^2].

    The centre of mass is the affine combination of the body's tracked points that lies nearest to
    it (for a rod with a cap at each end: exactly the centre of mass). NaN for a body without
    points.
    """
    difference = np.asarray(predicted) - np.asarray(truth)
    columns = []
    for body in robot.bodies:
        if body.points:
            com = np.einsum("p,...px->...x", robot.com_weights(body), _of(difference, body))
            columns.append((com**2).sum(axis=-1))
        else:
            columns.append(np.full(difference.shape[:-2], np.nan))
    return np.stack(columns, axis=-1)


def rotation_error(robot: Robot, truth: Floats, predicted: Floats) -> Floats:
    """Angle between the orientations of each body: (..., bodies) [deg].

    A body whose tracked points lie on one line (a rod) has an axis only, and the angle is between
    the axes; others are aligned by their points (Kabsch). NaN for a body with fewer than two
    points.
    """
    columns = []
    for body in robot.bodies:
        true, guess = _of(np.asarray(truth), body), _of(np.asarray(predicted), body)
        rank = _rank(robot, body)
        if rank == 0:
            columns.append(np.full(true.shape[:-2], np.nan))
        elif rank == 1:
            along = _along(robot, body)
            columns.append(_angle(_axis(along, true), _axis(along, guess)))
        else:
            columns.append(_kabsch_angle(true, guess))
    return np.degrees(np.stack(columns, axis=-1))


def shows_turn(robot: Robot, body: Body) -> bool:
    """True if a body has a rotation error: it has several tracked points in different places."""
    return _rank(robot, body) > 0


def squared_point_error(robot: Robot, truth: Floats, predicted: Floats) -> Floats:
    """Squared distance between each measured and predicted point: (..., P) [m^2]."""
    del robot
    return ((np.asarray(predicted) - np.asarray(truth)) ** 2).sum(axis=-1)


def _of(points: Floats, body: Body) -> Floats:
    return points[..., list(body.points), :]


def _rank(robot: Robot, body: Body) -> int:
    if len(body.points) < 2:
        return 0
    offsets = robot.offsets_of(body)
    return int(np.linalg.matrix_rank(offsets - offsets.mean(axis=0), tol=1e-6 * robot.length))


def _along(robot: Robot, body: Body) -> Floats:
    """(points,) coordinates of collinear points along their line, about their mean [m]."""
    offsets = robot.offsets_of(body)
    offsets = offsets - offsets.mean(axis=0)
    return offsets @ np.linalg.svd(offsets)[2][0]


def _axis(along: Floats, points: Floats) -> Floats:
    return np.einsum("p,...px->...x", along, points)  # not normalised: atan2 needs no unit vectors


def _angle(a: Floats, b: Floats) -> Floats:
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))


def _kabsch_angle(truth: Floats, predicted: Floats) -> Floats:
    """Angle of the rotation that aligns `truth` (..., points, 3) with `predicted` best [rad]."""
    missing = np.asarray(np.isnan(truth).any(axis=(-2, -1)))
    truth = np.where(missing[..., None, None], predicted, truth)
    a = truth - truth.mean(axis=-2, keepdims=True)
    b = predicted - predicted.mean(axis=-2, keepdims=True)
    u, _, vt = np.linalg.svd(np.swapaxes(a, -1, -2) @ b)
    flip = np.ones(u.shape[:-1])
    flip[..., 2] = np.linalg.det(u @ vt)  # a rotation, not a reflection
    rotation = u @ (flip[..., None] * vt)
    skew = rotation - np.swapaxes(rotation, -1, -2)
    sine = np.linalg.norm(skew, axis=(-2, -1)) / np.sqrt(8.0)
    cosine = (np.trace(rotation, axis1=-2, axis2=-1) - 1.0) / 2.0
    return np.where(missing, np.nan, np.arctan2(sine, cosine))
