"""Cables that get stiffer the more they are stretched."""

import numpy as np

from flywheel.effects.effect import Cables, Memory, Parameter, TensionEffect, Values
from flywheel.records import Floats

SHORTEST = 1e-3  # [m]: a simulation that diverged begins anew with cables of no length at all


class Stiffening(TensionEffect):
    """A cubic spring."""

    name = "stiffening"
    sizes = (Parameter("coefficient", "-", lambda s: 0.1, low=-5.0),)
    equation = "dT = b T (e / l0)^2"
    source = "Duffing's spring"
    shown_by = "high against low pretension, slowly"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        strain = cables.elastic / cables.stiffness / np.maximum(cables.rest, SHORTEST)
        return values["coefficient"] * cables.elastic * strain**2, memory
