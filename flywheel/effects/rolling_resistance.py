"""Ground that resists rolling."""

from collections.abc import Mapping

import mujoco

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.robots import Robot

ROLLING = 2  # column of MuJoCo's friction coefficients
PAIRED = slice(3, 5)  # the same of a pair of geoms, one for each direction
FULL = 6  # condim with sliding, turning and rolling friction


class RollingResistance(ModelEffect):
    """A moment against rolling, in proportion to the normal force."""

    name = "rolling_resistance"
    sizes = (Parameter("length", "m", lambda s: 0.1 * s.cap),)
    equation = "M = rho N"
    source = "MuJoCo's rolling friction"
    shown_by = "rolling over, and drops that roll out"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        model.geom_friction[:, ROLLING] += values["length"]
        model.geom_condim[model.geom_condim > 1] = FULL
        model.pair_friction[:, PAIRED] += values["length"]
        model.pair_dim[model.pair_dim > 1] = FULL
