"""Air, or a hose, that holds moving bodies back."""

from collections.abc import Mapping

import mujoco

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.robots import Robot

LINEAR = 3  # a free joint's first velocities are linear


class AirDrag(ModelEffect):
    """A force against the velocity of every body that moves freely."""

    name = "air_drag"
    sizes = (Parameter("drag", "N s/m", lambda s: 0.1 * s.weight * s.time / s.length / s.bodies),)
    equation = "F = -c v of each body"
    source = "Stokes' law"
    shown_by = "swinging or rolling fast"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        free = model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        for first in model.jnt_dofadr[free]:
            model.dof_damping[first : first + LINEAR] += values["drag"]
