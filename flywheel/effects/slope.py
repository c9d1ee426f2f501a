"""Ground that is not level."""

from collections.abc import Mapping

import mujoco
import numpy as np

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.robots import Robot


class Slope(ModelEffect):
    """The ground is tilted about the x- and y-axis: gravity is, seen from the ground."""

    name = "slope"
    sizes = (
        Parameter("about_x", "rad", lambda s: 0.03, low=-15.0, high=15.0),
        Parameter("about_y", "rad", lambda s: 0.03, low=-15.0, high=15.0),
    )
    equation = "g (sin ay, -sin ax, -sqrt(1 - sin^2 ax - sin^2 ay))"
    source = "geometry"
    shown_by = "rolling in two directions; lying still where friction is known"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        x, y = np.sin(values["about_y"]), -np.sin(values["about_x"])
        model.opt.gravity[:] = np.linalg.norm(model.opt.gravity) * np.array(
            [x, y, -np.sqrt(max(0.0, 1.0 - x**2 - y**2))]
        )
