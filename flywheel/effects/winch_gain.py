"""Winches that are faster or slower than they should be."""

import numpy as np

from flywheel.effects.effect import CommandEffect, Parameter, Values
from flywheel.records import Floats
from flywheel.robots import Robot


class WinchGain(CommandEffect):
    """All rates are off by one factor: another drum radius, another gear.

    A position winch still goes to where it was told, but at another rate. Its motor is taken to rest where
    its first command wants it.
    """

    name = "winch_gain"
    stage = 2
    sizes = (Parameter("share", "-", lambda s: 0.1, low=-5.0, high=5.0),)
    equation = "r -> (1 + g) r"
    source = "kinematics of the drum"
    shown_by = "long strokes"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        faster = 1.0 + values["share"]
        if robot.rate_driven.all():
            return controls * faster[:, None]
        drum = np.where(robot.rate_driven, 0.0, controls[:, 0])
        told = np.empty_like(controls)
        for step in range(controls.shape[1]):  # each rate of a position winch needs where it is
            rates = robot.rates(drum, controls[:, step], dt, faster)
            told[:, step] = robot.telling(drum, rates, dt)
            drum = drum + rates * dt
        return told
