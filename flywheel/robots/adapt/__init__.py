"""Adaptation of a laboratory's MJCF to a robot that can be used."""

from flywheel.robots.adapt.adapting import ADAPTATIONS, STRUCTURE, Adapted, adapt
from flywheel.robots.adapt.draft import Certainty, Change
from flywheel.robots.adapt.start import with_key, with_steps

__all__ = [
    "ADAPTATIONS",
    "STRUCTURE",
    "Adapted",
    "Certainty",
    "Change",
    "adapt",
    "with_key",
    "with_steps",
]
