"""Commands that act later than they were given."""

import numpy as np

from flywheel.effects.effect import CommandEffect, Parameter, Values
from flywheel.records import Floats
from flywheel.robots import Robot


class CommandDelay(CommandEffect):
    """Every command acts a fixed time later; before the first one the winches hold."""

    name = "command_delay"
    stage = 0
    sizes = (Parameter("time", "s", lambda s: 0.1 * s.time),)
    equation = "u(t) -> u(t - d)"
    source = "transport delay"
    shown_by = "sudden commands"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        return delayed(controls, values["time"] / dt, robot)


def delayed(controls: Floats, steps: Floats, robot: Robot) -> Floats:
    """Commands (n, T, W), `steps` (n, W) control steps later; parts of a step are shared out."""
    steps = np.round(steps, 9)  # 0.07 / 0.01 is a little more than seven
    total = controls.shape[1]
    first = np.where(robot.rate_driven, 0.0, controls[:, :1])
    padded = np.concatenate([first, controls], axis=1)
    whole = np.floor(steps)
    part = (steps - whole)[:, None]
    now = np.arange(1, total + 1)[None, :, None] - whole[:, None].astype(int)
    newer = np.take_along_axis(padded, np.maximum(now, 0), axis=1)
    older = np.take_along_axis(padded, np.maximum(now - 1, 0), axis=1)
    return np.where(part == 0, newer, (1 - part) * newer + part * older)
