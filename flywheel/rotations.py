"""Rotations in numpy: quaternions are unit, wxyz, (..., 4); vectors (..., 3); angles in radians."""

from __future__ import annotations

import numpy as np

from flywheel.records import Floats


def unit(vectors: Floats) -> Floats:
    """Vectors (..., n) scaled to length 1."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def cross(a: Floats, b: Floats) -> Floats:
    """Vector product (..., 3); NumPy's is several times slower for few vectors."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        product[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return product


def multiply(p: Floats, q: Floats) -> Floats:
    """The rotation that does `q` first, then `p`."""
    pw, pv, qw, qv = p[..., :1], p[..., 1:], q[..., :1], q[..., 1:]
    scalar = pw * qw - (pv * qv).sum(axis=-1, keepdims=True)
    return np.concatenate([scalar, pw * qv + qw * pv + cross(pv, qv)], axis=-1)


def conjugate(q: Floats) -> Floats:
    """The inverse rotation."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(q: Floats, v: Floats) -> Floats:
    """Vectors `v` rotated by `q`."""
    w, u = q[..., :1], q[..., 1:]
    twice = 2 * cross(u, v)
    return v + w * twice + cross(u, twice)


def about_axis(axis: Floats, angle: Floats) -> Floats:
    """Rotation by `angle` (...) [rad] about the unit vector `axis`."""
    half = np.asarray(angle)[..., None] / 2
    vector = axis * np.sin(half)
    scalar = np.broadcast_to(np.cos(half), (*vector.shape[:-1], 1))
    return np.concatenate([scalar, vector], axis=-1)


def shortest(a: Floats, b: Floats) -> Floats:
    """The smallest rotation that takes the direction of `a` to that of `b`.

    Opposite directions have no smallest one; they get half a turn about some perpendicular axis.
    """
    a, b = np.broadcast_arrays(unit(a), unit(b))
    scalar = 1 + (a * b).sum(axis=-1, keepdims=True)
    quaternion = np.concatenate([scalar, cross(a, b)], axis=-1)
    least = np.eye(3)[np.abs(a).argmin(axis=-1)]
    across = np.concatenate([np.zeros_like(scalar), cross(a, least)], axis=-1)
    return unit(np.where(scalar < 1e-12, across, quaternion))


def from_matrix(matrix: Floats) -> Floats:
    """Quaternions of rotation matrices (..., 3, 3), with the scalar part not negative."""
    m = np.asarray(matrix)
    trace = np.trace(m, axis1=-2, axis2=-1)
    diagonal = np.diagonal(m, axis1=-2, axis2=-1)
    off = np.stack(
        [
            m[..., 2, 1] - m[..., 1, 2],
            m[..., 0, 2] - m[..., 2, 0],
            m[..., 1, 0] - m[..., 0, 1],
        ],
        axis=-1,
    )
    # Each row is the quaternion times four times one of its entries; the largest is accurate.
    both = m + np.swapaxes(m, -1, -2)
    rows = np.empty((*trace.shape, 4, 4))
    rows[..., 0, 0] = 1 + trace
    rows[..., 0, 1:] = rows[..., 1:, 0] = off
    rows[..., 1:, 1:] = both
    entries = np.arange(1, 4)
    rows[..., entries, entries] = 1 + 2 * diagonal - trace[..., None]
    best = np.diagonal(rows, axis1=-2, axis2=-1).argmax(axis=-1)
    row = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    return unit(np.where(row[..., :1] < 0, -row, row))


def kabsch(points: Floats, onto: Floats) -> Floats:
    """The rotation that maps centred points (..., n, 3) onto others, in least squares.

    Points in one plane suffice; on one line the rotation about it is arbitrary.
    """
    u, _, vt = np.linalg.svd(np.swapaxes(onto, -1, -2) @ points)
    flip = np.ones((*u.shape[:-2], 3))
    flip[..., 2] = np.sign(np.linalg.det(u @ vt))
    return from_matrix((u * flip[..., None, :]) @ vt)
