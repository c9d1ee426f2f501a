"""Winches that are faster or slower than they should be."""

from flywheel.effects.effect import CommandEffect, Parameter, Values
from flywheel.records import Floats
from flywheel.robots import Robot


class WinchGain(CommandEffect):
    """All rates are off by one factor: another drum radius, another gear.

    A position winch goes to where it was told; of its command only the change is scaled.
    """

    name = "winch_gain"
    stage = 2
    sizes = (Parameter("share", "-", lambda s: 0.1, low=-5.0, high=5.0),)
    equation = "r -> (1 + g) r"
    source = "kinematics of the drum"
    shown_by = "long strokes"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        share = values["share"][:, None]
        scaled = controls * (1.0 + share)
        if robot.rate_driven.all():
            return scaled
        first = controls[:, :1]
        moved = first + (controls - first) * (1.0 + share)
        rate = robot.rate_driven
        return scaled * rate + moved * ~rate
