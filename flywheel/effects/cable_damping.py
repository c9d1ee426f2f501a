"""Cables that damp more than the MJCF says."""

from flywheel.effects.effect import Cables, Memory, Parameter, TensionEffect, Values
from flywheel.records import Floats


class CableDamping(TensionEffect):
    """Viscous damping of taut cables, beside the MJCF's."""

    name = "cable_damping"
    sizes = (Parameter("damping", "N s/m", lambda s: 0.5 * s.weight * s.time / s.length, low=-2.0),)
    equation = "dT = c V"
    source = "Kelvin-Voigt element"
    shown_by = "fast strokes of all winches"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["damping"] * cables.speed, memory
