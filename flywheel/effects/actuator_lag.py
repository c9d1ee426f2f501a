"""Winches that take their time to get up to speed."""

import numpy as np

from flywheel.effects.effect import CommandEffect, Parameter, Values
from flywheel.records import Floats
from flywheel.robots import Robot


class ActuatorLag(CommandEffect):
    """A first-order lag between command and winch."""

    name = "actuator_lag"
    stage = 1
    sizes = (Parameter("time", "s", lambda s: 0.2 * s.time),)
    equation = "a dr/dt = u - r"
    source = "first-order motor"
    shown_by = "sudden commands, held for a while"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        lag = values["time"]
        # the mean over a step of the exact response
        kept = np.exp(-dt / np.maximum(lag, 1e-9))
        mean = lag / dt * (1 - kept)
        state = np.where(robot.rate_driven, 0.0, controls[:, 0])
        told = np.empty_like(controls)
        for step in range(controls.shape[1]):  # each rate needs the one before
            wanted = controls[:, step]
            told[:, step] = np.where(lag > 0, wanted + (state - wanted) * mean, wanted)
            state = wanted + (state - wanted) * kept
        return told
