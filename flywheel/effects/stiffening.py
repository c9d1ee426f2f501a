"""Cables that get stiffer the more they are stretched."""

from flywheel.effects.effect import Cables, Memory, Parameter, TensionEffect, Values
from flywheel.records import Floats


class Stiffening(TensionEffect):
    """A cubic spring."""

    name = "stiffening"
    sizes = (Parameter("coefficient", "-", lambda s: 0.1, low=-5.0),)
    equation = "dT = b T (e / l0)^2"
    source = "Duffing's spring"
    shown_by = "high against low pretension, slowly"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        strain = cables.elastic / cables.stiffness / cables.rest
        return values["coefficient"] * cables.elastic * strain**2, memory
