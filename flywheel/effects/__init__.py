"""Physical causes that can be added to a plant.

A new one is a class in the file of its family, and one line in `EFFECTS`; the contract tests cover
it.
"""

from flywheel.effects import (
    body_effects,
    build_effects,
    cable_effects,
    forms,
    ground_effects,
    sensing_effects,
    winch_effects,
)
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
    points_late,
)
from flywheel.effects.forms import OtherForm
from flywheel.effects.per_part import PerPart, alike, at_largest_part, at_same_size, per_part_term
from flywheel.effects.probes import PROBES
from flywheel.effects.scales import Scales
from flywheel.effects.written import WrittenTerm

EFFECTS: dict[str, Effect] = {
    "cable_damping": cable_effects.CableDamping(),
    "cable_friction": cable_effects.CableFriction(),
    "capstan": cable_effects.Capstan(),
    "hysteresis": cable_effects.Hysteresis(),
    "creep": cable_effects.Creep(),
    "stiffening": cable_effects.Stiffening(),
    "weak_cable": cable_effects.WeakCable(),
    "winch_backlash": winch_effects.WinchBacklash(),
    "command_delay": winch_effects.CommandDelay(),
    "actuator_lag": winch_effects.ActuatorLag(),
    "winch_gain": winch_effects.WinchGain(),
    "torque_speed": winch_effects.TorqueSpeed(),
    "ground_friction": ground_effects.GroundFriction(),
    "rolling_resistance": ground_effects.RollingResistance(),
    "slope": ground_effects.Slope(),
    "contact_softness": ground_effects.ContactSoftness(),
    "air_drag": body_effects.AirDrag(),
    "payload": body_effects.Payload(),
    "marker_offset": sensing_effects.MarkerOffset(),
    "sensor_latency": sensing_effects.SensorLatency(),
}
# Corrections of numbers in the MJCF. Only considered where they are named.
CALIBRATIONS: dict[str, Effect] = {
    "cable_stiffness": cable_effects.CableStiffness(),
    "body_mass": body_effects.BodyMass(),
    "cable_length": build_effects.CableLength(),
    "cable_loss": build_effects.CableLoss(),
    "cable_end": build_effects.CableEnd(),
    "drum_radius": build_effects.DrumRadius(),
    "mass_of_body": build_effects.MassOfBody(),
    "inertia_of_body": build_effects.InertiaOfBody(),
    "inertia_by_axis": build_effects.InertiaByAxis(),
    "centre_of_mass": build_effects.CentreOfMass(),
}
# Other laws of effects of the library. Tried in the place of these, or where they are named.
FORMS: dict[str, OtherForm] = {
    "cable_damping_by_stiffness": forms.CableDampingByStiffness(),
    "cable_friction_by_stiffness": forms.CableFrictionByStiffness(),
    "hysteresis_by_stiffness": forms.HysteresisByStiffness(),
    "creep_on_length": forms.CreepOnLength(),
    "stiffening_by_strain": forms.StiffeningByStrain(),
    "winch_gain_on_length": forms.WinchGainOnLength(),
}
NAMED: dict[str, Effect] = {**EFFECTS, **CALIBRATIONS, **FORMS}

__all__ = [
    "CALIBRATIONS",
    "EFFECTS",
    "FORMS",
    "NAMED",
    "PROBES",
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
    "alike",
    "at_largest_part",
    "at_same_size",
    "handed_back",
    "handed_over",
    "is_number_of",
    "parts_of",
    "per_part_term",
    "place_name",
    "points_late",
    "taken_apart",
    "together",
    "usual",
]
