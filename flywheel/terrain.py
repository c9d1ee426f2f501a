"""Uneven ground: heights on a grid, split into triangles like MuJoCo's height fields."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from flywheel.errors import DataError

Numbers = TypeVar("Numbers", bound=Any)  # arrays or tensors
BRINK = 0.05  # of the plane around a terrain below its lowest place [m]


@dataclass(frozen=True, eq=False)
class Terrain:
    """Heights at the corners of square cells; a slightly lower plane surrounds them.

    Two terrains of equal numbers are equal.

    Attributes:
      heights: (X, Y) above the world's zero [m].
      cell: side of a cell [m].
      origin: (x, y) of the corner [0, 0] [m].
      digest: of all three.

    Raises:
      DataError: not a grid of finite heights.
    """

    heights: NDArray[np.floating]
    cell: float
    origin: tuple[float, float]
    digest: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        heights = np.ascontiguousarray(self.heights, np.float64)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise DataError(f"A terrain is a grid of at least 2 x 2 heights, got {heights.shape}.")
        if not np.isfinite(heights).all():
            raise DataError("A terrain's heights must be finite; got NaN or infinity.")
        if not (self.cell > 0 and np.isfinite(self.origin).all()):
            raise DataError(
                f"A terrain has cells of a positive size, and a corner somewhere; got {self.cell} and "
                f"{self.origin}."
            )
        heights.setflags(write=False)
        object.__setattr__(self, "heights", heights)
        place = np.array([*heights.shape, self.cell, *self.origin], np.float64)
        digest = hashlib.sha256(place.tobytes() + heights.tobytes()).hexdigest()
        object.__setattr__(self, "digest", digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Terrain) and other.digest == self.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    @property
    def plane(self) -> float:
        """Height of the plane around it [m]."""
        return float(self.heights.min()) - BRINK

    @property
    def size(self) -> tuple[float, float]:
        """Size of the grid along x and y [m]."""
        x, y = self.heights.shape
        return (x - 1) * self.cell, (y - 1) * self.cell

    def at(self, places: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Height (...) [m] and unit normal (..., 3) of the ground at places (..., 2)."""
        grid = (np.asarray(places, np.float64) - self.origin) / self.cell
        cells = np.array(self.heights.shape) - 1
        inside = np.asarray(((grid >= 0) & (grid <= cells)).all(axis=-1))
        corner = np.clip(np.floor(np.nan_to_num(grid)), 0, cells - 1).astype(np.int64)
        u, v = np.moveaxis(grid - corner, -1, 0)
        i, j = np.moveaxis(corner, -1, 0)
        h = self.heights
        height, slope_x, slope_y = facet(
            h[i, j], h[i + 1, j], h[i, j + 1], h[i + 1, j + 1], u, v, u >= v
        )
        normal = np.stack([-slope_x / self.cell, -slope_y / self.cell, np.ones_like(height)], -1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return (
            np.where(inside, height, self.plane),
            np.where(inside[..., None], normal, [0.0, 0.0, 1.0]),
        )

    def highest(self, low: NDArray[np.floating], high: NDArray[np.floating]) -> float:
        """Highest point of the ground in the rectangle between `low` (2,) and `high` (2,) [m]."""
        cells = np.array(self.heights.shape) - 1
        first = np.floor((np.asarray(low) - self.origin) / self.cell)
        last = np.ceil((np.asarray(high) - self.origin) / self.cell)
        beyond = (first < 0).any() or (last > cells).any()
        (i, j), (k, m) = (np.clip(at, 0, cells).astype(int) for at in (first, last))
        inside = float(self.heights[i : k + 1, j : m + 1].max())
        return max(inside, self.plane) if beyond else inside


def facet(
    near: Numbers,
    along_x: Numbers,
    along_y: Numbers,
    far: Numbers,
    u: Numbers,
    v: Numbers,
    below: Numbers,
) -> tuple[Numbers, Numbers, Numbers]:
    """Height within a cell, and its rise over a whole cell along x and along y.

    The cell's two triangles meet on the line between its `near` and `far` corners.

    Args:
      near, along_x, along_y, far: heights of the corners at (0, 0), (1, 0), (0, 1) and (1, 1).
      u, v: place in the cell, from 0 to 1 along x and y.
      below: True if u >= v.
    """
    above = 1 - 1 * below
    rise_x = (along_x - near) * below + (far - along_y) * above
    rise_y = (far - along_x) * below + (along_y - near) * above
    return near + u * rise_x + v * rise_y, rise_x, rise_y
