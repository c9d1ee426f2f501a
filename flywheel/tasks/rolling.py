"""Distance to a goal for a robot that rolls across its axis: it turns where the way leads elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from flywheel.errors import ConfigError
from flywheel.records import Floats
from flywheel.tasks.distance import Edges, Grid, moves_by

# Directions of rolling, counter-clockwise through half a turn: a robot rolls either way.
ROLLS = ((1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1))
HEADINGS = np.arctan2(*np.transpose(ROLLS)[::-1])  # their angles [rad]
LEVEL = 0.7  # least horizontal part of an axis across which a standing robot rolls


@dataclass(frozen=True)
class RollingWays:
    """Shortest ways to a goal, by place and by the direction in which a robot rolls.

    Attributes:
      axis: (P,) weights of the tracked points; their combination points along the robot's axis.
      ways: distances for each of `ROLLS` as its direction of rolling.
    """

    axis: Floats
    ways: tuple[Grid, ...]

    def __call__(self, points: Floats, places: Floats) -> Floats:
        """Distance (...) of a robot with its points at (..., P, 3) and its centre of mass at (..., 2) [m]."""
        axis = np.einsum("p,...pi->...i", self.axis, points[..., :2])
        rolls = np.arctan2(axis[..., 0], -axis[..., 1]) % np.pi
        headings = np.append(HEADINGS, np.pi)
        low = np.searchsorted(headings[1:-1], rolls, side="right")
        share = (rolls - headings[low]) / (headings[low + 1] - headings[low])
        found = np.stack([way(places) for way in (*self.ways, self.ways[0])])
        before, after = (np.take_along_axis(found, k[None], axis=0)[0] for k in (low, low + 1))
        return (1 - share) * before + share * after


def rolling_ways(grid: Grid, start: Floats, turn: float, aside: float) -> RollingWays:
    """The ways of a robot where a grid has paths to its goal.

    Args:
      grid: with the goal at a corner.
      start: (P, 3) tracked points of the standing robot [m].
      turn: way that counts as much as turning by one radian [m].
      aside: way that counts as much as one of the same length along the axis [-].

    Raises:
      ConfigError: the robot stands on its axis, or has none.
    """
    free = grid.apart == 0.0
    goal = np.unravel_index(grid.values.argmin(), free.shape)
    lengths = shortest_rolls(free, (int(goal[0]), int(goal[1])), turn / grid.cell, aside)
    nearest = distance_transform_edt(~free, return_distances=False, return_indices=True)
    ways = (way[tuple(nearest)] * grid.cell + grid.apart for way in lengths)
    return RollingWays(axis_of(start), tuple(replace(grid, values=way) for way in ways))


def axis_of(start: Floats) -> Floats:
    """(P,) weights whose combination of the tracked points is the axis of a robot standing at (P, 3).

    It is the principal axis of the points that differs most from the two others: a prism's from end to end.

    Raises:
      ConfigError: it is not level, or there is none.
    """
    around = start - start.mean(axis=0)
    moments, axes = np.linalg.eigh(around.T @ around)
    axis = axes[:, 2 if moments[2] - moments[1] >= moments[1] - moments[0] else 0]
    weights = around @ axis
    if np.linalg.norm(axis[:2]) < LEVEL or not weights.any():
        raise ConfigError(
            "task.turn is for robots that roll across a level axis, and this one has none; set it to 0."
        )
    return weights / np.abs(weights).sum()


def shortest_rolls(
    free: NDArray[np.bool_], start: tuple[int, int], turn: float, aside: float
) -> Floats:
    """Length (K, X, Y) of the shortest way to `start` over free corners in each of `ROLLS` at first; or inf.

    A move costs its length in cells, `aside` times that across the direction of rolling, and a change of
    this direction `turn` per radian. The direction at the end does not matter.
    """
    number = np.arange(len(ROLLS) * free.size).reshape(-1, *free.shape)
    edges = Edges(number.size)
    for k, (dx, dy) in enumerate(ROLLS):
        for x, y, factor in ((dx, dy, 1.0), (-dy, dx, aside)):
            here, there, passable = moves_by(x, y, free)
            length = factor * float(np.hypot(x, y))
            edges.connect(number[k][here][passable], number[k][there][passable], length)
        angle = np.diff(HEADINGS, append=np.pi)[k]
        edges.connect(number[k][free], number[(k + 1) % len(ROLLS)][free], turn * angle)
    return edges.shortest(number[:, start[0], start[1]]).reshape(number.shape)
