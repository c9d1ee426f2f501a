"""What is around a robot: gravity, and boxes that its plant collides with and its tasks plan around."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from flywheel.quantities import Metres, PositiveMetres

GRAVITY = 9.81  # for natural units; a simulation takes the MJCF's [m/s^2]


class Box(BaseModel):
    """An axis-aligned box obstacle.

    Attributes:
      center: (x, y, z) [m].
      half_size: (x, y, z) [m].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    center: tuple[Metres, Metres, Metres]
    half_size: tuple[PositiveMetres, PositiveMetres, PositiveMetres]
