"""Distance to a goal: in a straight line, or around boxes on a grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from flywheel.errors import ConfigError
from flywheel.records import Floats
from flywheel.robots import Box

Moves = Literal["diagonal", "manhattan"]
Corners = tuple[slice, slice]
STRAIGHT = ((1, 0), (0, 1))
DIAGONAL = ((1, 1), (1, -1))


@dataclass(frozen=True)
class StraightLine:
    """Euclidean distance to `goal` (2,) [m]."""

    goal: Floats

    def __call__(self, places: Floats) -> Floats:
        """Distance (...) from places (..., 2) to the goal [m]."""
        return np.linalg.norm(places - self.goal, axis=-1)

    def astray(self, places: Floats) -> Floats:
        """Zeros (...): a path leads from everywhere."""
        return np.zeros(places.shape[:-1])


@dataclass(frozen=True)
class Grid:
    """Distances to a goal known at the corners of square cells, bilinear in between.

    Attributes:
      origin: (2,) place [m] of the corner [0, 0].
      cell: side of a cell [m].
      values: (X, Y) distances at the corners [m].
      apart: (X, Y) distances to the nearest corner with a path to the goal [m]; `values` lead there.
    """

    origin: Floats
    cell: float
    values: Floats
    apart: Floats

    def __call__(self, places: Floats) -> Floats:
        """Distance (...) from places (..., 2) to the goal [m].

        A place outside the grid adds its straight distance to the grid.
        """
        last = np.array(self.values.shape) - 1
        wanted = (places - self.origin) / self.cell
        inside = np.clip(wanted, 0.0, last)
        low = np.minimum(inside.astype(np.intp), last - 1)
        x, y = low[..., 0], low[..., 1]
        u, v = (inside - low)[..., 0], (inside - low)[..., 1]
        left = (1 - v) * self.values[x, y] + v * self.values[x, y + 1]
        right = (1 - v) * self.values[x + 1, y] + v * self.values[x + 1, y + 1]
        outside = np.linalg.norm(wanted - inside, axis=-1) * self.cell
        return (1 - u) * left + u * right + outside

    def reaches(self, place: Floats) -> bool:
        """True if a path leads to the goal from the corner nearest to `place` (2,)."""
        return bool(self.astray(place) == 0.0)

    def astray(self, places: Floats) -> Floats:
        """Distance (...) to a path, from the corners nearest to places (..., 2) [m]; 0 on paths."""
        corner = np.rint((places - self.origin) / self.cell).astype(int)
        corner = np.clip(corner, 0, np.array(self.values.shape) - 1)
        return self.apart[corner[..., 0], corner[..., 1]]


def grid_around(
    goal: Floats,
    boxes: Sequence[Box],
    *,
    low: Floats,
    high: Floats,
    cell: float,
    clearance: float,
    moves: Moves = "diagonal",
) -> Grid:
    """Shortest paths to a goal that keep clear of boxes.

    Args:
      goal: (2,) [m].
      boxes: obstacles that are not tilted; their height is ignored, nothing passes over or under them.
      low, high: (2,) corners of the ground that the grid covers at least [m].
      cell: side of a cell [m].
      clearance: kept from the boxes [m].
      moves: "diagonal" moves to 8 neighbours, "manhattan" to the 4 along x and y.

    Raises:
      ConfigError: the goal lies outside of the ground, or in an obstacle or too close to one.
    """
    size = np.ceil((high - low) / cell).astype(int) + 1
    # The goal is a corner of the grid, so that the distance is exactly zero there and only there.
    origin = goal - np.ceil((goal - low) / cell) * cell
    start = np.rint((goal - origin) / cell).astype(int)
    if (start < 0).any() or (start >= size).any():
        raise ConfigError(f"The goal {_xy(goal)} lies outside of {_xy(low)} to {_xy(high)}.")
    corners = np.stack(np.meshgrid(*(np.arange(n) for n in size), indexing="ij"), axis=-1)
    blocked = near_boxes(origin + corners * cell, boxes, clearance)
    if blocked[tuple(start)]:
        raise ConfigError(
            f"The goal {_xy(goal)} lies in an obstacle or within {clearance:.3g} m of one. Move "
            "the goal or the obstacle, or lower the clearance."
        )
    values = shortest_ways(~blocked, (int(start[0]), int(start[1])), moves) * cell
    steps, nearest = distance_transform_edt(~np.isfinite(values), return_indices=True)
    apart = steps * cell
    return Grid(origin, cell, values[tuple(nearest)] + apart, apart)


def near_boxes(places: Floats, boxes: Sequence[Box], clearance: float) -> NDArray[np.bool_]:
    """(...) bool: True for places (..., 2) within `clearance` [m] of a box, seen from above."""
    near = np.zeros(places.shape[:-1], dtype=bool)
    for box in boxes:
        near |= np.linalg.norm(np.maximum(box.beside(places), 0.0), axis=-1) <= clearance
    return near


def in_the_way(boxes: Sequence[Box], headroom: float) -> list[Box]:
    """The boxes that paths lead around: neither ramps, nor `headroom` [m] or more above the ground."""
    return [box for box in boxes if not box.tilted and box.corners[:, 2].min() < headroom]


def shortest_ways(free: NDArray[np.bool_], start: tuple[int, int], moves: Moves) -> Floats:
    """Length (X, Y) of the shortest path from `start` over free corners, in cells; inf without one.

    A diagonal move needs both of the corners that it passes between to be free.
    """
    number = np.arange(free.size).reshape(free.shape)
    edges = Edges(free.size)
    for dx, dy in STRAIGHT if moves == "manhattan" else STRAIGHT + DIAGONAL:
        here, there, passable = moves_by(dx, dy, free)
        edges.connect(number[here][passable], number[there][passable], np.hypot(dx, dy))
    return edges.shortest(number[start]).reshape(free.shape)


class Edges:
    """A graph of `size` corners and the lengths between them, in cells."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._parts: list[tuple[Floats, NDArray[np.intp], NDArray[np.intp]]] = []

    def connect(self, first: NDArray[np.intp], second: NDArray[np.intp], length: float) -> None:
        """Connect corners (N,) with others (N,), both ways."""
        self._parts.append((np.full(len(first), length), first, second))

    def shortest(self, start: NDArray[np.intp]) -> Floats:
        """Length (size,) of the shortest path to the nearest of `start`; inf without one."""
        lengths, *ends = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        graph = coo_array((lengths, tuple(ends)), shape=(self._size, self._size)).tocsr()
        return dijkstra(graph, directed=False, indices=start, min_only=True)


def moves_by(
    dx: int, dy: int, free: NDArray[np.bool_]
) -> tuple[Corners, Corners, NDArray[np.bool_]]:
    """The corners with a neighbour at (dx, dy), these neighbours, and where a move between them is free.

    It is free where all corners of the cells that it crosses are.
    """
    x, y = (
        slice(max(-step, 0), size - max(step, 0))
        for step, size in zip((dx, dy), free.shape, strict=True)
    )
    passable = np.ones(free[x, y].shape, bool)
    for right in range(min(dx, 0), max(dx, 0) + 1):
        for up in range(min(dy, 0), max(dy, 0) + 1):
            passable &= free[_by(right, x), _by(up, y)]
    return (x, y), (_by(dx, x), _by(dy, y)), passable


def _by(step: int, corners: slice) -> slice:
    return slice(corners.start + step, corners.stop + step)


def _xy(place: Floats) -> str:
    return f"({place[0]:.3g}, {place[1]:.3g})"
