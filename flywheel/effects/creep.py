"""Cables that go on giving way under load."""

import numpy as np

from flywheel.effects.effect import Cables, Memory, Parameter, TensionEffect, Values
from flywheel.records import Floats


class Creep(TensionEffect):
    """Standard linear solid: a spring and damper in series, beside the cable's spring.

    The memory is the rest of the series spring: x = e - y, where y follows the extension e with the
    time constant tau, so that a quick stretch is resisted more than a slow one.
    """

    name = "creep"
    sizes = (Parameter("share", "-", lambda s: 0.15, high=10.0),)
    shapes = (Parameter("time", "s", lambda s: 0.5 * s.time, 0.05, 20.0, (0.3, 1.0, 3.0)),)
    equation = "dT = a k x, dx/dt = de/dt - x / tau"
    source = "Zener's model"
    shown_by = "a step of all winches, then holding still"
    remembers = True

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        # memory is y, the part of the extension that has relaxed; a slack cable starts anew
        extension = np.where(cables.taut, cables.elastic / cables.stiffness, 0.0)
        relaxed = np.where(cables.taut, np.where(memory == 0.0, extension, memory), 0.0)
        arm = extension - relaxed
        decay = np.exp(-cables.dt / np.maximum(values["time"], 1e-9))
        return values["share"] * cables.stiffness * arm, extension - arm * decay
