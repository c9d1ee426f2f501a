"""The ground below the robot, for the network's features."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from flywheel.terrain import Terrain, facet

Ground = Callable[[Tensor], tuple[Tensor, Tensor]]
"""Horizontal positions (2, N, K) [m] -> height of the ground there, broadcastable to (N, K) [m], and its
unit normal, broadcastable to (3, N, K)."""


def flat_ground(places: Tensor) -> tuple[Tensor, Tensor]:
    """The plane z = 0."""
    return places.new_zeros(1, 1), places.new_tensor([0.0, 0.0, 1.0]).view(3, 1, 1)


def ground_of(
    terrains: Sequence[Terrain | None], device: torch.device | str = "cpu", view: View | None = None
) -> Ground:
    """Grounds of samples with separate terrains; None is the plane z = 0.

    Args:
      terrains: of each of K samples, or one for all.
      device: of the lookup.
      view: of each sample; None if all are in world axes.
    """
    if all(terrain is None for terrain in terrains):
        return flat_ground
    distinct = list(dict.fromkeys(terrains))
    which = torch.tensor([distinct.index(terrain) for terrain in terrains], device=device)
    return _Surface(distinct, torch.device(device)).under(which, view)


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
        grids = [_PLANE if terrain is None else terrain for terrain in terrains]
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

    def under(self, which: Tensor, view: View | None) -> Ground:
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
            if view is not None:
                cos, sin = view.angle.cos(), view.angle.sin()
                slope_x, slope_y = cos * slope_x - sin * slope_y, sin * slope_x + cos * slope_y
            normal = torch.stack([-slope_x, -slope_y, torch.ones_like(slope_x)])
            return height, normal / (normal * normal).sum(0).sqrt()

        return ground


_PLANE = Terrain(np.zeros((2, 2)), 1.0, (0.0, 0.0))


def _back(places: Tensor, view: View) -> tuple[Tensor, Tensor]:
    """World coordinates of places (2, N, K) in the axes of a view."""
    x, y = places + view.shift[:, None]
    cos, sin = view.angle.cos(), view.angle.sin()
    return cos * x + sin * y, cos * y - sin * x
