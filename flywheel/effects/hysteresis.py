"""Cables whose tension depends on where they came from."""

import numpy as np

from flywheel.effects.effect import Cables, Memory, Parameter, TensionEffect, Values
from flywheel.records import Floats


class Hysteresis(TensionEffect):
    """Dahl's rate-independent friction: stiff for small strokes, constant for long ones."""

    name = "hysteresis"
    sizes = (Parameter("force", "N", lambda s: 0.05 * s.weight),)
    shapes = (Parameter("length", "m", lambda s: 0.01 * s.length, 0.05, 20.0, (0.4, 1.0, 2.5)),)
    equation = "dT = F z / d, dz/dt = V - |V| z / d"
    source = "P. Dahl, A solid friction model, 1968"
    shown_by = "small strokes to and fro, of a growing amplitude"
    remembers = True

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        length = np.maximum(values["length"], 1e-9)
        bent = np.where(cables.taut, memory, 0.0)
        # exact over a step of constant speed: z moves towards +-d over a way of d
        way = cables.speed * cables.dt
        goal = np.sign(way) * length
        return values["force"] * bent / length, goal + (bent - goal) * np.exp(-np.abs(way) / length)
