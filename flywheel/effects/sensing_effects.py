"""Effects between the true and the measured positions of points."""

from __future__ import annotations

import mujoco

from flywheel.effects.effect import CommandEffect, ModelEffect, Numbers, Parameter, Values
from flywheel.effects.winch_effects import delayed
from flywheel.records import Floats
from flywheel.robots import Robot, tracked_site


class MarkerOffset(ModelEffect):
    """A marker away from its place in the MJCF: measured at a constant offset on its body."""

    name = "marker_offset"
    where = "point"
    sizes = (
        Parameter("x", "m", lambda s: 0.01 * s.length, low=-20.0),
        Parameter("y", "m", lambda s: 0.01 * s.length, low=-20.0),
        Parameter("z", "m", lambda s: 0.01 * s.length, low=-20.0),
    )
    equation = "y = p + R (x, y, z)"
    source = "rigid-body kinematics"
    shown_by = "turning the body about all its axes"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        assert place is not None
        site, turn = tracked_site(model, robot.points[place])
        model.site_pos[site] += turn.T @ [values["x"], values["y"], values["z"]]


class SensorLatency(CommandEffect):
    """Every position is measured a fixed time later; channels are not.

    In the sensor's own time the commands are late: with commands and positions alone a latency
    equals a command delay exactly, and is computed as one. Channels are then read that much later.
    """

    name = "sensor_latency"
    stage = 0
    sizes = (Parameter("time", "s", lambda s: 0.1 * s.time),)
    equation = "y(t) = x(t - d)"
    source = "transport delay"
    shown_by = "sudden commands; a channel without the latency tells it from a command delay"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        return delayed(controls, values["time"] / dt, robot)

    def lateness(self, values: Numbers) -> float:
        return values["time"]
