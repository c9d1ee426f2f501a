"""Ground that is more, or less, slippery than the MJCF's."""

from collections.abc import Mapping

import mujoco

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.robots import Robot


class GroundFriction(ModelEffect):
    """One factor on all coefficients of sliding friction."""

    name = "ground_friction"
    sizes = (Parameter("share", "-", lambda s: 0.25, low=-3.6, high=12.0),)
    equation = "mu -> (1 + f) mu"
    source = "Coulomb's law"
    shown_by = "strokes that make the caps slide"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        model.geom_friction[:, 0] *= 1.0 + values["share"]
        model.pair_friction[:, :2] *= 1.0 + values["share"]
