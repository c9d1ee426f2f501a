"""The surroundings: heights on a grid, split into triangles like MuJoCo's height fields, and boxes."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from flywheel.errors import DataError
from flywheel.quantities import Bounds, Metres, PositiveMetres
from flywheel.validation import Frozen

Numbers = TypeVar("Numbers", bound=Any)  # arrays or tensors
Part = Annotated[float, Bounds(-1, 1)]  # of a unit quaternion
BRINK = 0.05  # of the plane around a terrain below its lowest place [m]
# By how much a quaternion's length may differ from 1: numbers in a file have few digits.
ROUNDING = 1e-3
UPRIGHT = 1e-9  # by how much the upward part of an upright box's axis may fall short of 1
NUMBERS = 10  # of a box: centre, half size, quaternion


class Box(Frozen):
    """A box that stands still: a wall, a ceiling, a ramp.

    Attributes:
      center: (x, y, z) [m].
      half_size: (x, y, z) along its own axes [m].
      quaternion: its rotation, (w, x, y, z) of length 1.
    """

    center: tuple[Metres, Metres, Metres]
    half_size: tuple[PositiveMetres, PositiveMetres, PositiveMetres]
    quaternion: tuple[Part, Part, Part, Part] = (1.0, 0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _turned_and_not_stretched(self) -> Self:
        if abs(float(np.linalg.norm(self.quaternion)) - 1.0) > ROUNDING:
            raise ValueError(f"quaternion needs a length of 1, got {self.quaternion}")
        return self

    @property
    def axes(self) -> NDArray[np.float64]:
        """(3, 3) its own axes as columns, in the world."""
        w, x, y, z = np.array(self.quaternion) / np.linalg.norm(self.quaternion)
        turned = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        return np.array(turned)

    @property
    def tilted(self) -> bool:
        """True for a ramp: none of its own axes is vertical."""
        return bool(np.abs(self.axes[2]).max() < 1.0 - UPRIGHT)

    @property
    def corners(self) -> NDArray[np.float64]:
        """(8, 3) in the world [m]."""
        signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij"), -1).reshape(8, 3)
        return np.array(self.center) + signs * self.half_size @ self.axes.T

    def beyond(self, places: NDArray[np.floating]) -> NDArray[np.float64]:
        """Distances (..., 3) of places (..., 3) beyond its faces, along its own axes [m].

        Negative between two faces.
        """
        return np.abs((places - np.array(self.center)) @ self.axes) - np.array(self.half_size)

    def beside(self, places: NDArray[np.floating]) -> NDArray[np.float64]:
        """Distances (..., 2) of places (..., 2) beyond the sides of a box that is not tilted [m]."""
        height = np.full_like(places[..., :1], self.center[2])
        beyond = self.beyond(np.concatenate([places, height], axis=-1))
        return np.delete(beyond, int(np.abs(self.axes[2]).argmax()), axis=-1)


def box_numbers(boxes: Sequence[Box]) -> NDArray[np.float64]:
    """(B, 10) centre and half size [m] and quaternion of each box."""
    rows = [[*box.center, *box.half_size, *box.quaternion] for box in boxes]
    return np.array(rows, np.float64).reshape(-1, NUMBERS)


def box_of(numbers: NDArray[np.floating]) -> Box:
    """The box of a row (10,) of `box_numbers`."""
    x, y, z, along, across, up, w, i, j, k = map(float, numbers)
    return Box(center=(x, y, z), half_size=(along, across, up), quaternion=(w, i, j, k))


@dataclass(frozen=True, eq=False)
class Terrain:
    """Heights at the corners of square cells, surrounded by a slightly lower plane, and boxes.

    Two terrains of equal numbers are equal.

    Attributes:
      heights: (X, Y) above the world's zero [m]; of size 0 for the plane z = 0.
      cell: side of a cell [m].
      origin: (x, y) of the corner [0, 0] [m].
      boxes: around the robot.
      digest: of all four.

    Raises:
      DataError: not a grid of finite heights.
    """

    heights: NDArray[np.floating]
    cell: float
    origin: tuple[float, float]
    boxes: tuple[Box, ...] = ()
    digest: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        heights = np.ascontiguousarray(self.heights, np.float64)
        if heights.ndim != 2 or (heights.shape != (0, 0) and min(heights.shape) < 2):
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
        numbers = place.tobytes() + heights.tobytes() + box_numbers(self.boxes).tobytes()
        object.__setattr__(self, "digest", hashlib.sha256(numbers).hexdigest())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Terrain) and other.digest == self.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    @property
    def plane(self) -> float:
        """Height of the plane around it [m]."""
        return float(self.heights.min()) - BRINK if self.heights.size else 0.0

    @property
    def size(self) -> tuple[float, float]:
        """Size of the grid along x and y [m]."""
        x, y = self.heights.shape
        return (x - 1) * self.cell, (y - 1) * self.cell

    def at(self, places: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Height (...) [m] and unit normal (..., 3) of the ground at places (..., 2); boxes are none."""
        if not self.heights.size:
            level = np.zeros(np.shape(places)[:-1])
            return level, np.broadcast_to([0.0, 0.0, 1.0], (*level.shape, 3))
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
        if not self.heights.size:
            return 0.0
        cells = np.array(self.heights.shape) - 1
        first = np.floor((np.asarray(low) - self.origin) / self.cell)
        last = np.ceil((np.asarray(high) - self.origin) / self.cell)
        beyond = (first < 0).any() or (last > cells).any()
        (i, j), (k, m) = (np.clip(at, 0, cells).astype(int) for at in (first, last))
        inside = float(self.heights[i : k + 1, j : m + 1].max())
        return max(inside, self.plane) if beyond else inside


LEVEL = Terrain(np.zeros((0, 0)), 1.0, (0.0, 0.0))


def is_level(terrain: Terrain | None) -> bool:
    """True if the ground is the plane z = 0."""
    return terrain is None or not terrain.heights.size


def with_boxes(terrain: Terrain | None, boxes: Sequence[Box]) -> Terrain | None:
    """A ground with these boxes besides its own, each once; None is the plane z = 0 without any."""
    here = terrain or LEVEL
    together = tuple(dict.fromkeys((*here.boxes, *boxes)))
    return replace(here, boxes=together) if together else terrain


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
