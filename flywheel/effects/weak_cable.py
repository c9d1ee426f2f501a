"""One cable that is softer than the others of its kind."""

from collections.abc import Mapping

import mujoco
import numpy as np

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.effects.stiffness import scale_stiffness
from flywheel.robots import Robot


class WeakCable(ModelEffect):
    """A share of the stiffness of one cable is missing."""

    name = "weak_cable"
    where = "cable"
    sizes = (Parameter("share", "-", lambda s: 0.2, low=-5.0, high=4.9),)
    equation = "dT = -s T at one cable"
    source = "Hooke's law"
    shown_by = "strokes that load the cables one after the other"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        assert place is not None
        scale_stiffness(model, np.array([place]), 1.0 - values["share"])
