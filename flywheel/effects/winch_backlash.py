"""Play between a winch's motor and its drum."""

import numpy as np

from flywheel.effects.effect import CommandEffect, Parameter, Values
from flywheel.records import Floats
from flywheel.robots import Robot


class WinchBacklash(CommandEffect):
    """The rest length follows the motor with free play, in the middle of it at the beginning."""

    name = "winch_backlash"
    stage = 3
    sizes = (Parameter("width", "m", lambda s: 0.01 * s.length),)
    equation = "l0 = clip(l0, m - b / 2, m + b / 2), m: position of the motor"
    source = "play operator (Krasnosel'skii)"
    shown_by = "winches that turn round often"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        half = values["width"] / 2
        rate = robot.rate_driven
        motor = np.where(rate, np.cumsum(controls, axis=1) * dt, controls)
        drum = np.where(rate, 0.0, controls[:, 0])
        told = np.empty_like(controls)
        for step in range(controls.shape[1]):  # each position needs the one before
            after = np.clip(drum, motor[:, step] - half, motor[:, step] + half)
            told[:, step] = np.where(rate, (after - drum) / dt, after)
            drum = after
        return np.where(half > 0, told.swapaxes(0, 1), controls.swapaxes(0, 1)).swapaxes(0, 1)
