"""Random ground: slopes, bumps and steps, with given boxes on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from flywheel.quantities import Bounds, PositiveRobotLengths
from flywheel.records import Floats
from flywheel.terrain import Box, Terrain, with_boxes
from flywheel.validation import Frozen

Kind = Literal["flat", "slope", "bumps", "steps"]
Range = tuple[PositiveRobotLengths, PositiveRobotLengths]
Steepness = Annotated[float, Bounds(0, 1.5, "rad", above=True)]  # short of upright
MOST_CELLS = 2000  # along a side: four million places, of which each episode keeps the heights
MOST_BOXES = 1000
MOST_KINDS = 100  # one may be named again, to be drawn more often
WAVES = 8  # plane waves that make bumps


class TerrainConfig(Frozen):
    """Distribution of grounds. Lengths are in units of the robot's length L.

    Attributes:
      kinds: of which each episode draws one; none for the plane everywhere. "flat" is the plane.
      slope: (least, most) rise of a slope [rad].
      bump_height: (least, most) half the difference between the highest and the lowest place of
        bumps [L].
      bump_length: (least, most) wavelength of bumps [L].
      step_height: (least, most) of a step up or down [L].
      step_length: (least, most) distance between steps [L].
      size: of the ground along x and y, around the origin [L]; a slightly lower plane surrounds it.
      cell: of its grid [L].
      boxes: in every episode [m]; a task adds its own, and only around these do its paths lead.
    """

    kinds: tuple[Kind, ...] = Field(default=(), max_length=MOST_KINDS)
    slope: tuple[Steepness, Steepness] = (0.03, 0.15)
    bump_height: Range = (0.02, 0.1)
    bump_length: Range = (0.8, 2.0)
    step_height: Range = (0.01, 0.05)
    step_length: Range = (0.8, 2.0)
    size: PositiveRobotLengths = 14.0
    cell: PositiveRobotLengths = 0.1
    boxes: tuple[Box, ...] = Field(default=(), max_length=MOST_BOXES)

    @model_validator(mode="after")
    def _ranges_rise_from_zero(self) -> Self:
        for name in ("slope", "bump_height", "bump_length", "step_height", "step_length"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(f"{name} needs 0 < least <= most, got {(low, high)}")
        if self.cell > self.size / 2:
            raise ValueError(
                f"ground of {self.size} L needs cells of at most half that, got {self.cell}"
            )
        if self.size / self.cell > MOST_CELLS:
            raise ValueError(
                f"ground of {self.size} L in cells of {self.cell} L has {self.size / self.cell:,.0f} cells "
                f"along a side; at most {MOST_CELLS:,}"
            )
        shortest = min(self.bump_length[0], self.step_length[0])
        if self.cell > shortest / 4:
            raise ValueError(
                f"cells of {self.cell} L are too large for bumps and steps of {shortest} L: at most a quarter"
            )
        return self


def draw_terrain(config: TerrainConfig, length: float, rng: np.random.Generator) -> Terrain | None:
    """A terrain around the origin, or None for the plane alone.

    Args:
      config: its distribution.
      length: of the robot, L [m].
      rng: source of randomness.
    """
    kind = str(rng.choice(config.kinds)) if config.kinds else "flat"
    if kind == "flat":
        return with_boxes(None, config.boxes)
    count = round(config.size / config.cell) + 1
    side = (np.arange(count) - (count - 1) / 2) * config.cell  # [L]
    x, y = np.meshgrid(side, side, indexing="ij")
    heights = _KINDS[kind](config, x, y, rng)
    corner = float(side[0] * length)
    return Terrain(heights * length, config.cell * length, (corner, corner), config.boxes)


def _slope(config: TerrainConfig, x: Floats, y: Floats, rng: np.random.Generator) -> Floats:
    return float(np.tan(rng.uniform(*config.slope))) * _along(x, y, rng)


def _bumps(config: TerrainConfig, x: Floats, y: Floats, rng: np.random.Generator) -> Floats:
    heights = np.zeros_like(x)
    for _ in range(WAVES):
        wave = 2.0 * np.pi / rng.uniform(*config.bump_length)
        heights += np.cos(wave * _along(x, y, rng) + rng.uniform(0.0, 2.0 * np.pi))
    middle = (heights.max() + heights.min()) / 2
    return np.asarray((heights - middle) / (np.ptp(heights) / 2) * rng.uniform(*config.bump_height))


def _steps(config: TerrainConfig, x: Floats, y: Floats, rng: np.random.Generator) -> Floats:
    way, spacing = _along(x, y, rng), rng.uniform(*config.step_length)
    number = np.floor(way / spacing + rng.uniform()).astype(int)
    number -= number.min()
    levels = np.cumsum(rng.choice((-1.0, 1.0), number.max() + 1))
    return np.asarray(rng.uniform(*config.step_height) * levels[number])


def _along(x: Floats, y: Floats, rng: np.random.Generator) -> Floats:
    """Coordinate of places along a random bearing."""
    bearing = rng.uniform(-np.pi, np.pi)
    return np.asarray(np.cos(bearing) * x + np.sin(bearing) * y)


_KINDS: dict[str, Callable[[TerrainConfig, Floats, Floats, np.random.Generator], Floats]] = {
    "slope": _slope,
    "bumps": _bumps,
    "steps": _steps,
}
