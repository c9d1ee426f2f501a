"""Adaptation of a laboratory's MJCF to a robot that can be used."""

from flywheel.robots.adapt.adapting import ADAPTATIONS, STRUCTURE, Adapted, adapt
from flywheel.robots.adapt.draft import Certainty, Change, Options
from flywheel.robots.adapt.start import with_key

__all__ = [
    "ADAPTATIONS",
    "STRUCTURE",
    "Adapted",
    "Certainty",
    "Change",
    "Options",
    "adapt",
    "with_key",
]
