"""A second simulator, which stands in for reality: its recordings have a known answer.

It moves a robot with effects that the model under test is not told of, in a loop and by laws of its own. It
shares no code with the plant or the library of effects: a diagnosis that names the effect does not owe that
to a mistake that both make. A test checks what it imports.

`HIDDEN` are the effects that a diagnosis is expected to name, `OUTSIDE` those it should say it has no
name for. `AsBuilt` is neither: a robot whose every number is a little off, as every real one's is.
"""

from flywheel.registry import lookup
from flywheel.truth_simulator.as_built import AsBuilt, Spread
from flywheel.truth_simulator.body_effects import AirDrag, Payload
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
    """The effect of this name, from either list, or "as_built".

    Raises:
      UnknownNameError: no such effect.
    """
    return lookup(HIDDEN | OUTSIDE | {"as_built": AsBuilt}, name, "hidden effect")


__all__ = [
    "HIDDEN",
    "OUTSIDE",
    "AsBuilt",
    "EffectTruth",
    "HiddenEffect",
    "HiddenMotion",
    "Simulation",
    "Spread",
    "TruthSimulator",
    "hidden_effect",
]
