"""Interface of hidden effects: numbers, a place, and a hook in the truth simulator.

An effect belongs to one of the families below; the simulator calls each family at one moment of its
step. Effects have no state: their memory (the set of a rope, the play of a gear) is an array that
the simulator keeps and returns. The base classes are the identity, so that an effect of size zero
changes no bit.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.cable_law import CableLaw
from flywheel.truth_simulator.cable_motion import CableMotion
from flywheel.truth_simulator.scales import Scales


@dataclass(frozen=True)
class EffectTruth:
    """The correct answer of a diagnosis.

    Attributes:
      name: of the effect.
      place: name of its cable or tracked point, "" for the whole robot.
      values: parameter -> value.
      units: parameter -> unit, "-" without one.
    """

    name: str
    place: str
    values: dict[str, float]
    units: dict[str, str]


@dataclass(frozen=True)
class HiddenEffect(ABC):
    """One physical cause. Its fields are its parameters; `cable` or `point` is its place.

    Attributes:
      name: in the registry.
      units: parameter -> unit. Fields that are missing here are no parameters.
      sized: the parameters that grow with the size of the effect; the first one by default.
    """

    name: ClassVar[str]
    units: ClassVar[Mapping[str, str]]
    sized: ClassVar[tuple[str, ...]]

    def __init_subclass__(cls) -> None:
        if "sized" not in vars(cls):
            cls.sized = tuple(getattr(cls, "units", ()))[:1]

    @classmethod
    @abstractmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        """The effect at its typical size for this robot; places and directions are drawn."""

    @classmethod
    def applies(cls, robot: Robot) -> bool:
        """True if it can have an influence on this robot."""
        return True

    def scaled(self, factor: float) -> Self:
        """The same effect with its size multiplied; 0 is no effect."""
        return dataclasses.replace(self, **{n: factor * getattr(self, n) for n in self.sized})

    def truth(self, robot: Robot) -> EffectTruth:
        """Its name, place and parameters in plain words and numbers."""
        place = ""
        if hasattr(self, "cable"):
            place = robot.cables[self.cable].name
        elif hasattr(self, "point"):
            place = robot.points[self.point].name
        values = {name: float(getattr(self, name)) for name in self.units}
        return EffectTruth(self.name, place, values, dict(self.units))


class GroundEffect(HiddenEffect):
    """An effect that acts through contacts only."""

    @classmethod
    def applies(cls, robot: Robot) -> bool:
        return robot.grounded and Scales.of(robot).cap_radius > 0


class ModelEffect(HiddenEffect):
    """An effect that changes masses, contacts or gravity before the simulation starts."""

    @abstractmethod
    def edit(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        """Write it into the MJCF."""


class CableEffect(HiddenEffect):
    """An effect on the tension of taut cables."""

    @abstractmethod
    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        """Added tension (C,) [N], and the memory (C,) one step later (zeros at first)."""


class WinchEffect(HiddenEffect):
    """An effect between the command and the rest lengths. Each overrides one stage."""

    @property
    def delay(self) -> float:
        """Delay of commands [s]."""
        return 0.0

    @property
    def gain(self) -> float:
        """Real over commanded rate; a position winch is that much faster [-]."""
        return 1.0

    def follow(self, command: Floats, memory: Floats, step: float) -> tuple[Floats, Floats]:
        """Mean command (W,) after the motors over a step, and the memory (W,)."""
        return command, memory

    def limit(self, rate: Floats, load: Floats, motor: Floats) -> Floats:
        """Real rates (W,) [m/s] under the loads (W,) [N], at motor positions (W,) [m]."""
        return rate

    def spool(self, motor: Floats, memory: Floats) -> Floats:
        """Paid-out length (W,) [m] at motor positions (W,), given that of a step ago (`memory`)."""
        return motor


class RestEffect(HiddenEffect):
    """An effect that changes rest lengths independently of the winches."""

    @abstractmethod
    def added(self, time: float, cables: int) -> Floats:
        """Added rest length (C,) [m]."""


class BodyEffect(HiddenEffect):
    """A force on the bodies."""

    @abstractmethod
    def force(self, time: float, velocity: Floats, mass: Floats) -> Floats:
        """Force (B, 3) [N] at the centres of mass, which move at `velocity` (B, 3)."""


class FlexEffect(HiddenEffect):
    """An effect that lets the tracked points, and the adjacent cable ends, give way."""

    @abstractmethod
    def bend(self, load: Floats, memory: Floats, step: float) -> Floats:
        """Displacements (P, 3) [m] under the loads (P, 3) [N], given those of the previous step."""


class SensingEffect(HiddenEffect):
    """An effect on the measurement alone."""

    @property
    def latency(self) -> float:
        """Age of a measured position [s]."""
        return 0.0

    def offset(self, robot: Robot) -> Floats:
        """(P, 3) true offsets of the markers from the tracked points, in body frames [m]."""
        return np.zeros((len(robot.points), 3))


class BuildEffect(HiddenEffect):
    """An effect on the cables of a robot, and on their attachments."""

    @abstractmethod
    def law(self, law: CableLaw) -> CableLaw:
        """The cables' numbers."""

    @abstractmethod
    def ends(self, offsets: Floats) -> Floats:
        """(2C, 3) positions of the cable ends, in the frames of their bodies [m]."""


@dataclass(frozen=True)
class Families:
    """Effects, sorted by family."""

    build: tuple[BuildEffect, ...]
    model: tuple[ModelEffect, ...]
    cable: tuple[CableEffect, ...]
    winch: tuple[WinchEffect, ...]
    rest: tuple[RestEffect, ...]
    body: tuple[BodyEffect, ...]
    flex: tuple[FlexEffect, ...]
    sensing: tuple[SensingEffect, ...]

    @classmethod
    def of(cls, effects: Sequence[HiddenEffect]) -> Families:
        return cls(
            build=tuple(e for e in effects if isinstance(e, BuildEffect)),
            model=tuple(e for e in effects if isinstance(e, ModelEffect)),
            cable=tuple(e for e in effects if isinstance(e, CableEffect)),
            winch=tuple(e for e in effects if isinstance(e, WinchEffect)),
            rest=tuple(e for e in effects if isinstance(e, RestEffect)),
            body=tuple(e for e in effects if isinstance(e, BodyEffect)),
            flex=tuple(e for e in effects if isinstance(e, FlexEffect)),
            sensing=tuple(e for e in effects if isinstance(e, SensingEffect)),
        )


def random_direction(rng: np.random.Generator, axes: int) -> Floats:
    """A unit vector (axes,) with no preferred direction."""
    vector = rng.normal(size=axes)
    return np.asarray(vector / np.linalg.norm(vector))
