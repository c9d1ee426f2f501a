"""The surfaces around the robot, for the network's features: the ground below, and boxes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from flywheel.terrain import Terrain, facet, is_level

Below = Callable[[Tensor], tuple[Tensor, Tensor]]
"""Horizontal positions (2, N, K) [m] -> height of the ground there, broadcastable to (N, K) [m], and its
unit normal, broadcastable to (3, N, K)."""


@dataclass(frozen=True)
class Ground:
    """The ground below samples, and the boxes around them.

    Attributes:
      below: the ground's surface.
      boxes: None without any.
    """

    below: Below
    boxes: Boxes | None = None

    def __call__(self, places: Tensor) -> tuple[Tensor, Tensor]:
        """See `Below`."""
        return self.below(places)

    @torch.no_grad()
    def nearest(self, places: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """Signed distances (count, N, K) [m] and unit normals (3, count, N, K) of the nearest boxes.

        Infinite and zero where there are fewer. They are constants: close by, a box is a plane.

        Args:
          places: (3, N, K) [m].
          count: boxes for each place.
        """
        away = places.new_full((count, *places.shape[1:]), torch.inf)
        normal = places.new_zeros(3, *away.shape)
        if self.boxes is not None:
            found = min(count, self.boxes.count)
            away[:found], normal[:, :found] = self.boxes.nearest(places, found)
        return away, normal


def _plane(places: Tensor) -> tuple[Tensor, Tensor]:
    """The plane z = 0."""
    return places.new_zeros(1, 1), places.new_tensor([0.0, 0.0, 1.0]).view(3, 1, 1)


flat_ground = Ground(_plane)


def ground_of(
    terrains: Sequence[Terrain | None], device: torch.device | str = "cpu", view: View | None = None
) -> Ground:
    """Surroundings of samples with separate terrains; None is the plane z = 0 alone.

    Args:
      terrains: of each of K samples, or one for all.
      device: of the lookup.
      view: of each sample; None if all are in world axes.
    """
    if not any(terrains):
        return flat_ground
    distinct = list(dict.fromkeys(terrains))
    which = torch.tensor([distinct.index(terrain) for terrain in terrains], device=device)
    below, boxes = flat_ground.below, None
    if not all(map(is_level, terrains)):
        below = _Surface(distinct, torch.device(device)).under(which, view)
    if any(terrain.boxes for terrain in distinct if terrain is not None):
        boxes = Boxes(distinct, which, view)
    return Ground(below, boxes)


@dataclass(frozen=True)
class View:
    """Axes of samples: turned about the vertical, then shifted.

    Attributes:
      angle: (K,) rotation of the world [rad].
      shift: (2, K) subtracted afterwards [m].
    """

    angle: Tensor
    shift: Tensor

    def __getitem__(self, rows: slice) -> View:
        """The view of some of the samples."""
        return View(self.angle[rows], self.shift[:, rows])


class _Surface:
    """G terrains as flat tensors, so that one lookup serves all samples."""

    def __init__(self, terrains: Sequence[Terrain | None], device: torch.device) -> None:
        grids = [_PLANE if t is None or is_level(t) else t for t in terrains]
        sizes = np.array([grid.heights.size for grid in grids])
        floors = [0.0 if t is None else t.plane for t in terrains]

        def on_device(values: object, dtype: torch.dtype) -> Tensor:
            return torch.as_tensor(np.asarray(values), dtype=dtype, device=device)

        self._heights = on_device(np.concatenate([g.heights.ravel() for g in grids]), torch.float32)
        self._first = on_device(np.cumsum(sizes) - sizes, torch.int64)
        self._shape = on_device([g.heights.shape for g in grids], torch.int64)
        self._origin = on_device([g.origin for g in grids], torch.float32)
        self._cell = on_device([g.cell for g in grids], torch.float32)
        self._floor = on_device(floors, torch.float32)

    def under(self, which: Tensor, view: View | None) -> Below:
        """The ground of samples on terrains `which` (K,)."""
        first, cell, floor = self._first[which], self._cell[which], self._floor[which]
        origin_x, origin_y = self._origin[which].t()
        cells_x, cells_y = (self._shape[which] - 1).t()
        heights = self._heights

        def ground(places: Tensor) -> tuple[Tensor, Tensor]:
            x, y = places if view is None else _back(places, view)
            x, y = (x - origin_x) / cell, (y - origin_y) / cell
            inside = (x >= 0) & (y >= 0) & (x <= cells_x) & (y <= cells_y)
            i = torch.minimum(x.floor().long().clamp(min=0), cells_x - 1)
            j = torch.minimum(y.floor().long().clamp(min=0), cells_y - 1)
            corner, row = first + i * (cells_y + 1) + j, cells_y + 1
            near, along_y = heights[corner], heights[corner + 1]
            along_x, far = heights[corner + row], heights[corner + row + 1]
            u, v = x - i, y - j
            height, rise_x, rise_y = facet(near, along_x, along_y, far, u, v, u >= v)
            height = torch.where(inside, height, floor)
            slope_x, slope_y = (rise * inside / cell for rise in (rise_x, rise_y))
            normal = torch.stack([-slope_x, -slope_y, torch.ones_like(slope_x)])
            normal = normal if view is None else _turned(normal, view)
            return height, normal / (normal * normal).sum(0).sqrt()

        return ground


_PLANE = Terrain(np.zeros((2, 2)), 1.0, (0.0, 0.0))


def _turned(vectors: Tensor, view: View) -> Tensor:
    """Vectors (3, ..., K) of the world in the axes of a view."""
    cos, sin, (x, y, z) = view.angle.cos(), view.angle.sin(), vectors
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z])


def _back(places: Tensor, view: View) -> tuple[Tensor, Tensor]:
    """World coordinates of places (2, N, K) in the axes of a view."""
    x, y = places + view.shift[:, None]
    cos, sin = view.angle.cos(), view.angle.sin()
    return cos * x + sin * y, cos * y - sin * x


class Boxes:
    """The boxes around samples, in one batch.

    Args:
      terrains: G distinct ones.
      which: (K,) terrain of each sample.
      view: of each sample; None if all are in world axes.

    Attributes:
      count: the most around any sample.
    """

    def __init__(
        self, terrains: Sequence[Terrain | None], which: Tensor, view: View | None
    ) -> None:
        around = [() if terrain is None else terrain.boxes for terrain in terrains]
        self.count, self._view = max(map(len, around)), view
        center, half = np.zeros((2, 3, self.count, 1, len(around)))
        axes = np.zeros((3, 3, self.count, 1, len(around)))
        missing = np.ones((self.count, 1, len(around)), bool)
        for g, boxes in enumerate(around):
            for b, box in enumerate(boxes):
                center[:, b, 0, g], half[:, b, 0, g] = box.center, box.half_size
                axes[:, :, b, 0, g], missing[b, 0, g] = box.axes, False
        numbers = (torch.as_tensor(array, device=which.device) for array in (center, half, axes))
        self._center, self._half, self._axes = (array.float()[..., which] for array in numbers)
        self._missing = torch.as_tensor(missing, device=which.device)[..., which]

    def nearest(self, places: Tensor, count: int) -> tuple[Tensor, Tensor]:
        """As `Ground.nearest`, of at most `self.count` boxes."""
        if self._view is not None:
            places = torch.stack([*_back(places[:2], self._view), places[2]])
        own = (self._axes * (places[:, None] - self._center)[:, None]).sum(0)
        beyond = own.abs() - self._half
        outside = beyond.clamp(min=0.0)
        far, (inside, face) = (outside * outside).sum(0).sqrt(), beyond.max(0)
        away = torch.where(far > 0.0, far, inside).masked_fill(self._missing, torch.inf)
        away, first = away.topk(count, dim=0, largest=False)
        nearest_face = torch.nn.functional.one_hot(face, 3).movedim(-1, 0)
        way = torch.where(far > 0.0, outside / far, nearest_face) * torch.where(
            own < 0.0, -1.0, 1.0
        )
        normal = (self._axes * way).sum(1).gather(1, first.expand(3, *first.shape))
        normal = normal.masked_fill(away.isinf(), 0.0)
        if self._view is None:
            return away, normal
        return away, _turned(normal, self._view)
