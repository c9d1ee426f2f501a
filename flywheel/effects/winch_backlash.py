"""Play between a winch's motor and its drum."""

import numpy as np

from flywheel.effects.effect import CommandEffect, Parameter, Values
from flywheel.records import Floats
from flywheel.robots import Robot


class WinchBacklash(CommandEffect):
    """The rest length follows the motor with free play, in the middle of it at the beginning.

    The motor of a position winch is taken to rest where its first command wants it.
    """

    name = "winch_backlash"
    stage = 3
    sizes = (Parameter("width", "m", lambda s: 0.01 * s.length),)
    equation = "l0 = clip(l0, m - b / 2, m + b / 2), m: position of the motor"
    source = "play operator (Krasnosel'skii)"
    shown_by = "winches that turn round often"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        half = values["width"] / 2
        motor = drum = np.where(robot.rate_driven, 0.0, controls[:, 0])
        told = np.empty_like(controls)
        for step in range(controls.shape[1]):  # each position needs the one before
            motor = motor + robot.rates(motor, controls[:, step], dt) * dt
            after = np.clip(drum, motor - half, motor + half)
            told[:, step] = robot.telling(drum, (after - drum) / dt, dt)
            drum = after
        return np.where(half > 0, told.swapaxes(0, 1), controls.swapaxes(0, 1)).swapaxes(0, 1)
