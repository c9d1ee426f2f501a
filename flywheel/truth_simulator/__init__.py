"""A second simulator in the role of reality: its recordings have a known answer.

It moves a robot with effects unknown to the model under test, with its own loop and laws. It shares
no code with the plant or the library of effects: a correct diagnosis is therefore not due to a
mistake common to both. A test checks its imports.

`HIDDEN` are the effects that a diagnosis should name, `OUTSIDE` and `UNKNOWN_LAWS` those for which
it should report an unknown, and `OTHER_FORMS` those that it can name, but with another law.
`AsBuilt` is a robot with small errors in all numbers, like every real one.
"""

from flywheel.registry import lookup
from flywheel.truth_simulator.body_effects import AirDrag, Payload
from flywheel.truth_simulator.built_robot import AsBuilt, Spread
from flywheel.truth_simulator.cable_effects import (
    CableDamping,
    CableFriction,
    Capstan,
    Creep,
    Hysteresis,
    Stiffening,
    WeakCable,
)
from flywheel.truth_simulator.effect import EffectTruth, HiddenEffect
from flywheel.truth_simulator.ground_effects import (
    ContactSoftness,
    GroundFriction,
    RollingResistance,
    Slope,
)
from flywheel.truth_simulator.other_laws import OTHER_FORMS, UNKNOWN_LAWS
from flywheel.truth_simulator.outside import (
    CableSlip,
    Cogging,
    Gust,
    QuadraticDamping,
    RodFlex,
    StiffnessDrift,
)
from flywheel.truth_simulator.sensing_effects import MarkerOffset, SensorLatency
from flywheel.truth_simulator.simulator import HiddenMotion, Simulation, TruthSimulator
from flywheel.truth_simulator.winch_effects import (
    ActuatorLag,
    CommandDelay,
    TorqueSpeed,
    WinchBacklash,
    WinchGain,
)

HIDDEN: dict[str, type[HiddenEffect]] = {
    "cable_damping": CableDamping,
    "cable_friction": CableFriction,
    "capstan": Capstan,
    "hysteresis": Hysteresis,
    "creep": Creep,
    "stiffening": Stiffening,
    "weak_cable": WeakCable,
    "winch_backlash": WinchBacklash,
    "command_delay": CommandDelay,
    "actuator_lag": ActuatorLag,
    "winch_gain": WinchGain,
    "torque_speed": TorqueSpeed,
    "ground_friction": GroundFriction,
    "rolling_resistance": RollingResistance,
    "slope": Slope,
    "contact_softness": ContactSoftness,
    "air_drag": AirDrag,
    "payload": Payload,
    "marker_offset": MarkerOffset,
    "sensor_latency": SensorLatency,
}

OUTSIDE: dict[str, type[HiddenEffect]] = {
    "gust": Gust,
    "cogging": Cogging,
    "cable_slip": CableSlip,
    "quadratic_damping": QuadraticDamping,
    "stiffness_drift": StiffnessDrift,
    "rod_flex": RodFlex,
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
