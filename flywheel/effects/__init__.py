"""Physical causes that can be added to a plant. A new one is one file and one line here."""

from flywheel.effects.actuator_lag import ActuatorLag
from flywheel.effects.adopted import AdoptedPlant
from flywheel.effects.air_drag import AirDrag
from flywheel.effects.body_mass import BodyMass
from flywheel.effects.cable_damping import CableDamping
from flywheel.effects.cable_friction import CableFriction
from flywheel.effects.cable_stiffness import CableStiffness
from flywheel.effects.capstan import Capstan
from flywheel.effects.command_delay import CommandDelay
from flywheel.effects.contact_softness import ContactSoftness
from flywheel.effects.creep import Creep
from flywheel.effects.effect import (
    Cables,
    CommandEffect,
    Effect,
    ModelEffect,
    Parameter,
    TensionEffect,
    Term,
    Terms,
    WinchEffect,
    place_name,
)
from flywheel.effects.ground_friction import GroundFriction
from flywheel.effects.hysteresis import Hysteresis
from flywheel.effects.marker_offset import MarkerOffset
from flywheel.effects.payload import Payload
from flywheel.effects.rolling_resistance import RollingResistance
from flywheel.effects.scales import Scales
from flywheel.effects.sensor_latency import SensorLatency
from flywheel.effects.slope import Slope
from flywheel.effects.stiffening import Stiffening
from flywheel.effects.torque_speed import TorqueSpeed
from flywheel.effects.weak_cable import WeakCable
from flywheel.effects.winch_backlash import WinchBacklash
from flywheel.effects.winch_gain import WinchGain
from flywheel.effects.written import WrittenTerm

EFFECTS: dict[str, Effect] = {
    "cable_damping": CableDamping(),
    "cable_friction": CableFriction(),
    "capstan": Capstan(),
    "hysteresis": Hysteresis(),
    "creep": Creep(),
    "stiffening": Stiffening(),
    "weak_cable": WeakCable(),
    "winch_backlash": WinchBacklash(),
    "command_delay": CommandDelay(),
    "actuator_lag": ActuatorLag(),
    "winch_gain": WinchGain(),
    "torque_speed": TorqueSpeed(),
    "ground_friction": GroundFriction(),
    "rolling_resistance": RollingResistance(),
    "slope": Slope(),
    "contact_softness": ContactSoftness(),
    "air_drag": AirDrag(),
    "payload": Payload(),
    "marker_offset": MarkerOffset(),
    "sensor_latency": SensorLatency(),
}
# What an MJCF has numbers of, which may be wrong. Only considered where somebody names them.
CALIBRATIONS: dict[str, Effect] = {
    "cable_stiffness": CableStiffness(),
    "body_mass": BodyMass(),
}
NAMED: dict[str, Effect] = {**EFFECTS, **CALIBRATIONS}

__all__ = [
    "CALIBRATIONS",
    "EFFECTS",
    "NAMED",
    "AdoptedPlant",
    "Cables",
    "CommandEffect",
    "Effect",
    "ModelEffect",
    "Parameter",
    "Scales",
    "TensionEffect",
    "Term",
    "Terms",
    "WinchEffect",
    "WrittenTerm",
    "place_name",
]
