"""Friction at a guide, in proportion to the tension."""

from flywheel.effects.effect import Cables, Memory, Parameter, TensionEffect, Values
from flywheel.records import Floats


class Capstan(TensionEffect):
    """A cable that rubs around its guide: friction grows with the tension."""

    name = "capstan"
    sizes = (Parameter("coefficient", "-", lambda s: 0.05, high=10.0),)
    equation = "dT = mu T tanh(V / v0)"
    source = "Euler-Eytelwein, exp(mu theta) - 1 for small angles"
    shown_by = "the same strokes at low and at high pretension"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["coefficient"] * cables.elastic * cables.direction, memory
