"""Positions that are seen later than they were."""

from flywheel.effects.command_delay import delayed
from flywheel.effects.effect import CommandEffect, Parameter, Values
from flywheel.records import Floats
from flywheel.robots import Robot


class SensorLatency(CommandEffect):
    """Every position is seen a fixed time later.

    In the sensor's own time it is the commands that come late: with nothing but commands and positions
    a latency is a command delay, exactly, and is computed as one.
    """

    name = "sensor_latency"
    stage = 0
    sizes = (Parameter("time", "s", lambda s: 0.1 * s.time),)
    equation = "y(t) = x(t - d)"
    source = "transport delay"
    shown_by = "sudden commands; a channel without the latency tells it from a command delay"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        return delayed(controls, values["time"] / dt, robot)
