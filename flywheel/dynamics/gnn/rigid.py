"""Rigid bodies from points, and points from rigid bodies.

A body is described by a *frame*: the position of the centroid of its tracked points and as many
unit vectors as those points determine: none for a single point, one (the axis) for points on a
line, as on a rod, three for points that span a plane or space. Offsets in the body enter only
through their coordinates along these vectors, so invisible quantities (a rod's roll) have no
effect.

Frames are fitted by least squares over an affine motion of the body, whose vectors are then made
orthonormal: an axis is normalised, three vectors are replaced by the nearest rotation (their polar
factor, by Newton-Schulz iterations). For a rigid motion that is exact; unlike a singular value
decomposition it is differentiable everywhere.

Arrays are component-major: (3, ..., M, K) for M points of K samples.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.gnn.nodes import BodyNode
from flywheel.records import Floats
from flywheel.robots import Robot

_ITERATIONS = 6
_FLAT = 1e-4  # singular values below this fraction of the robot's length span no direction


class BodyAxes:
    """Directions in one body that its tracked points determine.

    Args:
      points: (m, 3) offsets of the tracked points in the body frame [m].
      length: of the robot [m].

    Attributes:
      centroid: (3,) of the points, in the body frame [m].
      vectors: (r, 3) orthonormal, r of 0, 1, 3; a single one points along the body's z-axis, not
        against it.
    """

    def __init__(self, points: Floats, length: float) -> None:
        self.centroid = points.mean(axis=0)
        _, sizes, vectors = np.linalg.svd(points - self.centroid)
        rank = int((sizes > _FLAT * length).sum())
        if rank == 1:
            lead = vectors[0]
            biggest = lead[2] if abs(lead[2]) > 1e-6 else lead[np.argmax(np.abs(lead))]
            self.vectors = lead[None] * np.sign(biggest)
        elif rank >= 2:
            third = np.cross(vectors[0], vectors[1])
            self.vectors = np.stack([vectors[0], vectors[1], third])
        else:
            self.vectors = np.zeros((0, 3))

    def coordinates(self, offsets: Floats) -> Floats:
        """(m, r) coordinates of `offsets` (m, 3) along the vectors, from the centroid."""
        return (offsets - self.centroid) @ self.vectors.T


class Frames:
    """The layout of all bodies' frames in one array (3, ..., F, K).

    Its rows are the bodies' centroids, then the axes of bodies with one vector, then the first,
    the second and the third vectors of bodies with three.

    Args:
      robot: the robot.
      nodes: its body nodes.
      device: of the matrices.

    Attributes:
      to_nodes, to_points: (N, F), (P, F) matrices from frames to positions.
      to_arms: (N, F) to the vectors from each node's body's centre of mass to the node.
      to_axes: (N, F) to each node's body's z-axis, or to its only axis.
      from_nodes: (F, N) least-squares fit of frames to nodes, before vectors are made orthonormal.
      rods: the bodies with only a visible axis; row `rod_rows[i]` is that of rod i's axis.
    """

    def __init__(self, robot: Robot, nodes: tuple[BodyNode, ...], device: torch.device) -> None:
        self._robot = robot
        offsets = [p.offset for p in robot.points]
        self._axes = [
            BodyAxes(np.array([offsets[p] for p in body.points]), robot.length)
            for body in robot.bodies
        ]
        self._number_rows()
        self.rods = tuple(b for b, axes in enumerate(self._axes) if len(axes.vectors) == 1)
        self.rod_rows = [self._row[b, 0] for b in self.rods]
        of_nodes = [node.body for node in nodes]
        of_points = [point.body for point in robot.points]
        places = np.array([node.offset for node in nodes])
        com = np.array([robot.bodies[node.body].com for node in nodes])

        def tensor(matrix: Floats) -> Tensor:
            return torch.as_tensor(matrix, dtype=torch.float32, device=device)

        to_nodes = self._positions(of_nodes, places)
        to_points = self._positions(of_points, np.array(offsets))
        self.to_nodes, self.to_points = tensor(to_nodes), tensor(to_points)
        self.to_arms = tensor(to_nodes - self._positions(of_nodes, com))
        self.to_axes = tensor(self._z_axes(of_nodes))
        self.from_nodes = tensor(self._fit(of_nodes, to_nodes))
        self._from_points = tensor(self._fit(of_points, to_points))
        self.body_of_node = torch.as_tensor(of_nodes, device=device)
        self.body_of_point = torch.as_tensor(of_points, device=device)

    def _number_rows(self) -> None:
        count = len(self._axes)
        self._row = {}
        single = [b for b, axes in enumerate(self._axes) if len(axes.vectors) == 1]
        triple = [b for b, axes in enumerate(self._axes) if len(axes.vectors) == 3]
        for i, b in enumerate(single):
            self._row[b, 0] = count + i
        for k in range(3):
            for i, b in enumerate(triple):
                self._row[b, k] = count + len(single) + k * len(triple) + i
        self.bodies, self.single, self.triple = count, len(single), len(triple)
        self.rows = count + len(single) + 3 * len(triple)

    def _positions(self, bodies: list[int], offsets: Floats) -> Floats:
        """Matrix (m, F) from frames to the positions of `offsets` (m, 3) in `bodies`."""
        matrix = np.zeros((len(bodies), self.rows))
        for i, b in enumerate(bodies):
            matrix[i, b] = 1.0
            for k, x in enumerate(self._axes[b].coordinates(offsets[i : i + 1])[0]):
                matrix[i, self._row[b, k]] = x
        return matrix

    def vectors(self, body: int) -> Floats:
        """(r, 3) a body's vectors in its frame."""
        return self._axes[body].vectors

    def across(self, body: int, offset: Floats) -> Floats:
        """(2,) invisible coordinates of a place in a rod, across its axis [m].

        They are along two directions fixed in the rod, the second one axis x first.
        """
        arm, axis = offset - self._axes[body].centroid, self._axes[body].vectors[0]
        first = np.eye(3)[np.abs(axis).argmin()]
        first = first - (first @ axis) * axis
        first = first / np.linalg.norm(first)
        return np.array([arm @ first, arm @ np.cross(axis, first)])

    def along(self, bodies: list[int], offsets: Floats) -> Floats:
        """Matrix (m, F) from frames to the visible part of the positions of `offsets` (m, 3).

        A body of -1 stands for none: a row of zeros.
        """
        matrix = np.zeros((len(bodies), self.rows))
        own = [i for i, b in enumerate(bodies) if b >= 0]
        matrix[own] = self._positions([bodies[i] for i in own], offsets[own])
        return matrix

    def _z_axes(self, bodies: list[int]) -> Floats:
        matrix = np.zeros((len(bodies), self.rows))
        for i, b in enumerate(bodies):
            vectors = self._axes[b].vectors
            shares = np.ones(1) if len(vectors) == 1 else vectors[:, 2]
            for k, share in enumerate(shares):
                matrix[i, self._row[b, k]] = share
        return matrix

    def _fit(self, bodies: list[int], to_places: Floats) -> Floats:
        """Matrix (F, m) of the affine least-squares fit of frames to places.

        If the places of a body with three vectors lie in a plane, its third vector gets zeros here
        and is the cross product of the others.
        """
        matrix = np.zeros((self.rows, len(bodies)))
        for b in range(self.bodies):
            members = [i for i, other in enumerate(bodies) if other == b]
            rows = [b] + [self._row[b, k] for k in range(len(self._axes[b].vectors))]
            block = to_places[np.ix_(members, rows)]
            if len(rows) == 4 and np.abs(block[:, 3]).max() < _FLAT * self._robot.length:
                rows, block = rows[:3], block[:, :3]
            matrix[np.ix_(rows, members)] = np.linalg.pinv(block)
        return matrix

    def of_nodes(self, positions: Tensor) -> Tensor:
        """Frames (3, ..., F, K) fitted to body nodes (3, ..., N, K)."""
        return self._orthonormal(torch.matmul(self.from_nodes, positions))

    def of_points(self, positions: Tensor) -> Tensor:
        """Frames (3, ..., F, K) fitted to tracked points (3, ..., P, K)."""
        return self._orthonormal(torch.matmul(self._from_points, positions))

    def _orthonormal(self, raw: Tensor) -> Tensor:
        head = self.bodies + self.single
        parts = [raw[..., : self.bodies, :]]
        if self.single:
            axes = raw[..., self.bodies : head, :]
            parts.append(axes / (axes * axes).sum(0).clamp(min=1e-12).sqrt())
        if self.triple:
            vectors = raw[..., head:, :].unflatten(-2, (3, self.triple))
            parts.append(nearest_rotation(vectors).flatten(-3, -2))
        return torch.cat(parts, dim=-2)


def nearest_rotation(vectors: Tensor) -> Tensor:
    """The rotation nearest to three vectors; a third vector of 0 is made from the others.

    Args:
      vectors: (3, ..., 3, B, K): components first, then which vector.
    """
    first, second, third = vectors.unbind(-3)
    missing = (third * third).sum(0, keepdim=True) == 0.0
    third = torch.where(missing, torch.linalg.cross(first, second, dim=0), third)
    matrix = torch.stack([first, second, third], dim=-3)
    size = (matrix * matrix).sum(dim=(0, -3), keepdim=True).clamp(min=1e-12).sqrt()
    matrix = matrix * (
        1.5 / size
    )  # largest singular value below sqrt(3), where iterations converge
    for _ in range(_ITERATIONS):
        gram = (matrix.unsqueeze(-3) * matrix.unsqueeze(-4)).sum(0)
        matrix = 1.5 * matrix - 0.5 * (gram * matrix.unsqueeze(-4)).sum(-3)
    return matrix
