"""Bodies that are heavier or lighter than the MJCF says, all alike."""

from collections.abc import Mapping

import mujoco

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.robots import Robot


class BodyMass(ModelEffect):
    """A share that the mass and inertia of every body have more."""

    name = "body_mass"
    sizes = (Parameter("share", "-", lambda s: 0.05, low=-15.0, high=40.0),)
    equation = "m (1 + s), I (1 + s) of every body"
    source = "Newton's second law"
    shown_by = "drops and fast strokes"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        model.body_mass[:] *= 1.0 + values["share"]
        model.body_inertia[:] *= 1.0 + values["share"]
