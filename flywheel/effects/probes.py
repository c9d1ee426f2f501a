"""Laws outside the library, by which a diagnosis tests the form of its answer; they are never an answer."""

from __future__ import annotations

import numpy as np

from flywheel.effects.effect import (
    Cables,
    CommandEffect,
    Effect,
    Memory,
    Parameter,
    TensionEffect,
    Values,
)
from flywheel.records import Floats
from flywheel.robots import Robot


class QuadraticDamping(TensionEffect):
    """Damping in proportion to the square of the speed, as in a fluid."""

    name = "damping_by_speed_squared"
    sizes = (
        Parameter(
            "damping", "N s^2/m^2", lambda s: 2.0 * s.weight * (s.time / s.length) ** 2, low=-20.0
        ),
    )
    equation = "dT = c |V| V"
    source = "drag"
    shown_by = "fast strokes of all winches"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["damping"] * np.abs(cables.speed) * cables.speed, memory


class TensionDamping(TensionEffect):
    """Damping in proportion to the tension."""

    name = "damping_by_tension"
    sizes = (Parameter("time", "s", lambda s: 0.02 * s.time, low=-20.0),)
    equation = "dT = a T V / l0"
    source = "first order in tension and speed"
    shown_by = "fast strokes at high and low pretension"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["time"] * cables.elastic * cables.speed / cables.rest, memory


class StiffnessDrift(TensionEffect):
    """Cables that lose stiffness, or gain some, during a recording. The memory is the time."""

    name = "stiffness_in_time"
    sizes = (Parameter("rate", "1/s", lambda s: 0.02 / s.time, low=-20.0),)
    equation = "dT = -a t T"
    source = "first order in time"
    shown_by = "the same motion early and late in a recording"
    remembers = True

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return -values["rate"] * memory * cables.elastic, memory + cables.dt


class RateDependentGain(CommandEffect):
    """Winches with a nonlinear rate."""

    name = "gain_by_rate"
    stage = 2
    sizes = (Parameter("share", "-", lambda s: 0.1, low=-5.0, high=5.0),)
    equation = "r -> (1 + g |r| / r_max) r"
    source = "second order in the command"
    shown_by = "strokes at different rates"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        full = np.maximum(np.abs(robot.control_low), np.abs(robot.control_high))
        more = values["share"][:, None] * np.abs(controls) / full
        return controls * (1.0 + more * robot.rate_driven)


PROBES: dict[str, Effect] = {
    probe.name: probe
    for probe in (QuadraticDamping(), TensionDamping(), StiffnessDrift(), RateDependentGain())
}
