"""Other laws of effects of the library: the same physical cause, with as many parameters.

A diagnosis tries them in place of an identified effect, before it looks for a second one. If cables
differ, *in proportion to stiffness* is relative to their mean, so that sizes have the same meaning
in both laws.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from flywheel.effects.cable_effects import (
    CableDamping,
    CableFriction,
    Creep,
    Hysteresis,
    Stiffening,
)
from flywheel.effects.effect import RESTS, Cables, Effect, Memory, TensionEffect, Values
from flywheel.effects.winch_effects import WinchGain, wound_on
from flywheel.records import Floats
from flywheel.robots import Robot

EVEN = 1.01  # times the stiffness of the softest cable, up to which all are equally stiff
BY_STIFFNESS = "in proportion to the stiffness of each cable"


class OtherForm(Effect):
    """An effect with another law than that of its family.

    Attributes:
      of: name of the family.
    """

    of: ClassVar[str]

    @property
    def family(self) -> str:
        return self.of

    def differs_on(self, robot: Robot) -> bool:
        """True if a robot can distinguish it from the effect of its family."""
        return True


class ByStiffness(OtherForm, TensionEffect):
    """The tension of another effect, in proportion to the stiffness of each cable."""

    winch_kinds = RESTS
    form = BY_STIFFNESS

    def differs_on(self, robot: Robot) -> bool:
        stiffness = [cable.stiffness for cable in robot.cables]
        return max(stiffness) > min(stiffness) * EVEN

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        extra, after = super().tension(cables, memory, values)  # type: ignore[safe-super]
        return extra * cables.stiffness / cables.stiffness.mean(axis=1, keepdims=True), after


class CableFrictionByStiffness(ByStiffness, CableFriction):
    """Coulomb friction of stiff cables that is larger than that of soft ones."""

    name = "cable_friction_by_stiffness"
    of = CableFriction.name
    equation = "dT = F (k / mean k) tanh(V / v0)"
    shown_by = "slow strokes to and fro of stiff cables, and of soft ones"


class CableDampingByStiffness(ByStiffness, CableDamping):
    """Viscous damping of stiff cables that is larger than that of soft ones."""

    name = "cable_damping_by_stiffness"
    of = CableDamping.name
    equation = "dT = c (k / mean k) V"
    shown_by = "fast strokes of stiff cables, and of soft ones"


class HysteresisByStiffness(ByStiffness, Hysteresis):
    """Dahl's friction of stiff cables that is larger than that of soft ones."""

    name = "hysteresis_by_stiffness"
    of = Hysteresis.name
    equation = "dT = F (k / mean k) z / d, dz/dt = V - |V| z / d"
    shown_by = "small strokes to and fro of stiff cables, and of soft ones"


class CreepOnLength(OtherForm, Creep):
    """A relaxing arm that follows the length of a cable, not its stretch.

    A winch that hauls in does not load it; a cable that is drawn out does.
    """

    name = "creep_on_length"
    form = "on the length of each cable, not on its stretch"
    of = Creep.name
    equation = "dT = a k x, dx/dt = V - x / tau"
    shown_by = "a step of all winches against a step of the load"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        time = np.maximum(values["time"], 1e-9)
        arm = np.where(cables.taut, memory, 0.0)
        goal = cables.speed * time  # exact over a step of constant speed
        after = goal + (arm - goal) * np.exp(-cables.dt / time)
        return values["share"] * cables.stiffness * arm, after


class StiffeningByStrain(OtherForm, Stiffening):
    """Cables that get stiffer from the first stretch on: a quadratic spring."""

    name = "stiffening_by_strain"
    form = "with the first power of the strain, not with the second"
    of = Stiffening.name
    equation = "dT = b T e / l0"
    source = "second order in the extension"
    shown_by = "low against very low pretension, slowly"
    power = 1


class WinchGainOnLength(OtherForm, WinchGain):
    """Position winches that wind more, or less, than commanded: the drum has another radius.

    Rate winches have the gain of their family.
    """

    name = "winch_gain_on_length"
    form = "on the length that is wound up, not on the rate"
    of = WinchGain.name
    winch_kinds = RESTS
    equation = "l -> l_k + (1 + g) (l - l_k), l_k: length in the keyframe"
    shown_by = "long strokes, held"

    def differs_on(self, robot: Robot) -> bool:
        return not robot.rate_driven.all() and not robot.tension_driven

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        return wound_on(controls, values["share"], robot)
