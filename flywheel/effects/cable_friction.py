"""Friction that every moving cable has to overcome."""

from flywheel.effects.effect import Cables, Memory, Parameter, TensionEffect, Values
from flywheel.records import Floats


class CableFriction(TensionEffect):
    """Coulomb friction of a force that is always the same, against the cable's motion."""

    name = "cable_friction"
    sizes = (Parameter("force", "N", lambda s: 0.05 * s.weight),)
    equation = "dT = F tanh(V / v0)"
    source = "Coulomb's law, smooth below v0 = 0.01 L / sqrt(L / g)"
    shown_by = "slow strokes to and fro at one pretension"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["force"] * cables.direction, memory
