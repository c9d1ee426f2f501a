"""Windows of measured data as inputs of a network."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from torch import Tensor

from flywheel.dynamics.rigid_bodies.ground import Ground, View, ground_of
from flywheel.terrain import Terrain


@dataclass(frozen=True)
class Batch:
    """Windows as network inputs, float32, each shifted so that its present is near the origin.

    Attributes:
      past_points: (B, h + 1, P, 3) [m].
      past_controls: (B, h, W).
      past_winch: (B, h + 1, W) best estimate of the winch positions [m].
      controls: (B, S, W) of the predicted steps.
      points: (B, S + 2, P, 3) the plant's, or measured and smoothed, from the step before the present to
        the last one [m]; NaN where neither is known.
      winch: (B, S, W) the plant's, or measured, at those steps [m]; NaN if neither is known.
      dataset: (B,) index of the data set, int64.
      terrains: under each of B, or one for all.
      view: axes of the windows.
    """

    past_points: Tensor
    past_controls: Tensor
    past_winch: Tensor
    controls: Tensor
    points: Tensor
    winch: Tensor
    dataset: Tensor
    terrains: tuple[Terrain | None, ...]
    view: View

    def __getitem__(self, rows: slice) -> Batch:
        """Some of the windows."""
        parts = {name: part[rows] for name, part in self._tensors().items()}
        terrains = self.terrains if len(self.terrains) == 1 else self.terrains[rows]
        return Batch(**parts, terrains=terrains, view=self.view[rows])

    def to(self, device: str) -> Batch:
        """A copy on a device."""
        parts = {name: part.to(device) for name, part in self._tensors().items()}
        view = View(self.view.angle.to(device), self.view.shift.to(device))
        return Batch(**parts, terrains=self.terrains, view=view)

    @property
    def ground(self) -> Ground:
        """The ground below the windows' robots."""
        return ground_of(self.terrains, self.controls.device, self.view)

    def _tensors(self) -> dict[str, Tensor]:
        parts = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: part for name, part in parts.items() if isinstance(part, Tensor)}
