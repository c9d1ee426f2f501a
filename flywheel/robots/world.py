"""Surroundings of a robot: gravity, and boxes for collisions in the plant and for planning in tasks."""

from __future__ import annotations

from flywheel.quantities import Metres, PositiveMetres
from flywheel.validation import Frozen

GRAVITY = 9.81  # for natural units; a simulation takes the MJCF's [m/s^2]


class Box(Frozen):
    """An axis-aligned box obstacle.

    Attributes:
      center: (x, y, z) [m].
      half_size: (x, y, z) [m].
    """

    center: tuple[Metres, Metres, Metres]
    half_size: tuple[PositiveMetres, PositiveMetres, PositiveMetres]
