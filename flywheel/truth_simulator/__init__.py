"""A second simulator in the role of reality: its recordings have a known answer.

It moves a robot with effects unknown to the model under test, with its own loop and laws. It shares
no code with the plant or the library of effects: a correct diagnosis is therefore not due to a
mistake common to both. A test checks its imports.

`HIDDEN` are the effects that a diagnosis should name, `OUTSIDE` and `UNKNOWN_LAWS` those for which
it should report an unknown, and `OTHER_FORMS` those that it can name, but with another law.
`AsBuilt` is a robot with small errors in all numbers, like every real one.
"""

from flywheel.registry import lookup
from flywheel.truth_simulator import (
    body_effects,
    cable_effects,
    ground_effects,
    outside,
    sensing_effects,
    winch_effects,
)
from flywheel.truth_simulator.built_robot import AsBuilt, Spread
from flywheel.truth_simulator.effect import EffectTruth, HiddenEffect
from flywheel.truth_simulator.other_laws import OTHER_FORMS, UNKNOWN_LAWS
from flywheel.truth_simulator.simulator import HiddenMotion, Simulation, TruthSimulator

HIDDEN: dict[str, type[HiddenEffect]] = {
    "cable_damping": cable_effects.CableDamping,
    "cable_friction": cable_effects.CableFriction,
    "capstan": cable_effects.Capstan,
    "hysteresis": cable_effects.Hysteresis,
    "creep": cable_effects.Creep,
    "stiffening": cable_effects.Stiffening,
    "weak_cable": cable_effects.WeakCable,
    "winch_backlash": winch_effects.WinchBacklash,
    "command_delay": winch_effects.CommandDelay,
    "actuator_lag": winch_effects.ActuatorLag,
    "winch_gain": winch_effects.WinchGain,
    "torque_speed": winch_effects.TorqueSpeed,
    "ground_friction": ground_effects.GroundFriction,
    "rolling_resistance": ground_effects.RollingResistance,
    "slope": ground_effects.Slope,
    "contact_softness": ground_effects.ContactSoftness,
    "air_drag": body_effects.AirDrag,
    "payload": body_effects.Payload,
    "marker_offset": sensing_effects.MarkerOffset,
    "sensor_latency": sensing_effects.SensorLatency,
}

OUTSIDE: dict[str, type[HiddenEffect]] = {
    "gust": outside.Gust,
    "cogging": outside.Cogging,
    "cable_slip": outside.CableSlip,
    "quadratic_damping": outside.QuadraticDamping,
    "stiffness_drift": outside.StiffnessDrift,
    "rod_flex": outside.RodFlex,
}


def hidden_effect(name: str) -> type[HiddenEffect]:
    """The effect of this name, from any of the lists, or "as_built".

    Raises:
      UnknownNameError: no such effect.
    """
    kinds: dict[str, type[HiddenEffect]] = {AsBuilt.name: AsBuilt, **OTHER_FORMS, **UNKNOWN_LAWS}
    return lookup({**HIDDEN, **OUTSIDE, **kinds}, name, "hidden effect")


__all__ = [
    "HIDDEN",
    "OTHER_FORMS",
    "OUTSIDE",
    "UNKNOWN_LAWS",
    "AsBuilt",
    "EffectTruth",
    "HiddenEffect",
    "HiddenMotion",
    "Simulation",
    "Spread",
    "TruthSimulator",
    "hidden_effect",
]
