"""Physical causes that can be added to a plant.

A new one is a class in the file of its family, and one line in `EFFECTS`; the contract tests cover
it.
"""

from flywheel.effects.adopted import AdoptedPlant
from flywheel.effects.as_built import (
    AsBuilt,
    Part,
    handed_back,
    handed_over,
    is_number_of,
    taken_apart,
    together,
    usual,
)
from flywheel.effects.body_effects import AirDrag, BodyMass, Payload
from flywheel.effects.build_effects import (
    CableEnd,
    CableLength,
    CableLoss,
    CentreOfMass,
    DrumRadius,
    InertiaOfBody,
    MassOfBody,
)
from flywheel.effects.cable_effects import (
    CableDamping,
    CableFriction,
    CableStiffness,
    Capstan,
    Creep,
    Hysteresis,
    Stiffening,
    WeakCable,
)
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
    Winches,
    parts_of,
    place_name,
)
from flywheel.effects.forms import (
    CableDampingByStiffness,
    CableFrictionByStiffness,
    CreepOnLength,
    HysteresisByStiffness,
    OtherForm,
    StiffeningByStrain,
    WinchGainOnLength,
)
from flywheel.effects.ground_effects import (
    ContactSoftness,
    GroundFriction,
    RollingResistance,
    Slope,
)
from flywheel.effects.per_part import (
    PerPart,
    acts_on_same_parts,
    alike,
    at_largest_part,
    at_same_size,
    per_part_term,
    with_shares,
)
from flywheel.effects.scales import Scales
from flywheel.effects.sensing_effects import MarkerOffset, SensorLatency
from flywheel.effects.winch_effects import (
    ActuatorLag,
    CommandDelay,
    TorqueSpeed,
    WinchBacklash,
    WinchGain,
)
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
# Corrections of numbers in the MJCF. Only considered where they are named.
CALIBRATIONS: dict[str, Effect] = {
    "cable_stiffness": CableStiffness(),
    "body_mass": BodyMass(),
    "cable_length": CableLength(),
    "cable_loss": CableLoss(),
    "cable_end": CableEnd(),
    "drum_radius": DrumRadius(),
    "mass_of_body": MassOfBody(),
    "inertia_of_body": InertiaOfBody(),
    "centre_of_mass": CentreOfMass(),
}
# Other laws of effects of the library. Tried in the place of these, or where they are named.
FORMS: dict[str, OtherForm] = {
    "cable_damping_by_stiffness": CableDampingByStiffness(),
    "cable_friction_by_stiffness": CableFrictionByStiffness(),
    "hysteresis_by_stiffness": HysteresisByStiffness(),
    "creep_on_length": CreepOnLength(),
    "stiffening_by_strain": StiffeningByStrain(),
    "winch_gain_on_length": WinchGainOnLength(),
}
NAMED: dict[str, Effect] = {**EFFECTS, **CALIBRATIONS, **FORMS}

__all__ = [
    "CALIBRATIONS",
    "EFFECTS",
    "FORMS",
    "NAMED",
    "AdoptedPlant",
    "AsBuilt",
    "Cables",
    "CommandEffect",
    "Effect",
    "ModelEffect",
    "OtherForm",
    "Parameter",
    "Part",
    "PerPart",
    "Scales",
    "TensionEffect",
    "Term",
    "Terms",
    "WinchEffect",
    "Winches",
    "WrittenTerm",
    "acts_on_same_parts",
    "alike",
    "at_largest_part",
    "at_same_size",
    "handed_back",
    "handed_over",
    "is_number_of",
    "parts_of",
    "per_part_term",
    "place_name",
    "taken_apart",
    "together",
    "usual",
    "with_shares",
]
