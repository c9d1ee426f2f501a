"""Cables that are stiffer or softer than the MJCF says, all alike."""

from collections.abc import Mapping

import mujoco
import numpy as np

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.effects.stiffness import scale_stiffness
from flywheel.robots import Robot


class CableStiffness(ModelEffect):
    """A share that the stiffness of every cable has more."""

    name = "cable_stiffness"
    sizes = (Parameter("share", "-", lambda s: 0.05, low=-15.0, high=40.0),)
    equation = "k (1 + s) of every cable"
    source = "Hooke's law"
    shown_by = "slow strokes of all winches"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        scale_stiffness(model, np.arange(len(robot.cables)), 1.0 + values["share"])
