"""Winches that slow down under load."""

import numpy as np

from flywheel.effects.effect import Parameter, Values, WinchEffect
from flywheel.records import Floats


class TorqueSpeed(WinchEffect):
    """A motor that loses speed in proportion to its load while it hauls in."""

    name = "torque_speed"
    sizes = (Parameter("slope", "1/N", lambda s: 0.1 / s.weight),)
    equation = "r -> r max(0, 1 - q T) where r < 0"
    source = "torque-speed line of a DC motor"
    shown_by = "fast hauling at high pretension"

    def rate(self, rate: Floats, load: Floats, values: Values) -> Floats:
        slower = np.maximum(0.0, 1.0 - values["slope"] * load)
        return np.where(rate < 0, rate * slower, rate)
