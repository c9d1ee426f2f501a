"""What a hidden effect is: numbers, a place, and where it takes hold of the truth simulator.

An effect belongs to one of the families below; the simulator asks each family at one moment of its
step. Effects hold no state: what one has to remember (the set of a rope, the play of a gear) is an
array that the simulator keeps for it and hands back. The base classes are the identity, so that an
effect of size zero changes nothing to the bit.
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
    """The answer that a diagnosis should find.

    Attributes:
      name: of the effect.
      place: name of the cable or tracked point it sits at, "" where it is everywhere.
      values: parameter -> value.
      units: parameter -> unit, "-" where it has none.
    """

    name: str
    place: str
    values: dict[str, float]
    units: dict[str, str]


@dataclass(frozen=True)
class HiddenEffect(ABC):
    """One physical cause. Its fields are its parameters; `cable` or `point` is where it is.

    Attributes:
      name: in the registry.
      units: parameter -> unit. Fields that are missing here are no parameters.
      sized: the parameters that grow with the size of the effect.
    """

    name: ClassVar[str]
    units: ClassVar[Mapping[str, str]]
    sized: ClassVar[tuple[str, ...]]

    @classmethod
    @abstractmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        """The effect at its typical size for this robot; places and directions are drawn."""

    @classmethod
    def applies(cls, robot: Robot) -> bool:
        """Whether it can make a difference to this robot at all."""
        return True

    def scaled(self, factor: float) -> Self:
        """The same effect, so many times as large; 0 is no effect."""
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
    """One that is felt through contacts only."""

    @classmethod
    def applies(cls, robot: Robot) -> bool:
        return robot.grounded and Scales.of(robot).cap_radius > 0


class ModelEffect(HiddenEffect):
    """One that rewrites masses, contacts or gravity before the simulation starts."""

    @abstractmethod
    def edit(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        """Write it into the MJCF."""


class CableEffect(HiddenEffect):
    """One that adds to the tension of cables. A slack cable never feels it."""

    @abstractmethod
    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        """Added tension (C,) [N], and the memory (C,) one step later (zeros at first)."""


class WinchEffect(HiddenEffect):
    """One between the command and the rest lengths. Each overrides one stage."""

    @property
    def delay(self) -> float:
        """How late commands arrive [s]."""
        return 0.0

    @property
    def gain(self) -> float:
        """Real over commanded rate; a position winch is that much faster [-]."""
        return 1.0

    def follow(self, command: Floats, memory: Floats, step: float) -> tuple[Floats, Floats]:
        """What the motors take for the command (W,) on average over a step, and the memory (W,)."""
        return command, memory

    def limit(self, rate: Floats, load: Floats, motor: Floats) -> Floats:
        """Real rates (W,) [m/s] under the loads (W,) [N], at motor positions (W,) [m]."""
        return rate

    def spool(self, motor: Floats, memory: Floats) -> Floats:
        """Paid-out length (W,) [m] at motor positions (W,), given that of a step ago (`memory`)."""
        return motor


class RestEffect(HiddenEffect):
    """One that changes rest lengths behind the winches' back."""

    @abstractmethod
    def added(self, time: float, cables: int) -> Floats:
        """Added rest length (C,) [m]."""


class BodyEffect(HiddenEffect):
    """A force on the bodies."""

    @abstractmethod
    def force(self, time: float, velocity: Floats, mass: Floats) -> Floats:
        """Force (B, 3) [N] at the centres of mass, which move at `velocity` (B, 3)."""


class FlexEffect(HiddenEffect):
    """One that lets the tracked points, and the cables that end beside them, give way."""

    @abstractmethod
    def bend(self, load: Floats, memory: Floats, step: float) -> Floats:
        """Displacements (P, 3) [m] under the loads (P, 3) [N], given those of a step ago."""


class SensingEffect(HiddenEffect):
    """One that changes what is seen, and not what happens."""

    @property
    def latency(self) -> float:
        """How old a measured position is [s]."""
        return 0.0

    def offset(self, robot: Robot) -> Floats:
        """(P, 3) where the markers really are, from the tracked points, in body frames [m]."""
        return np.zeros((len(robot.points), 3))


class BuildEffect(HiddenEffect):
    """One that changes what the cables of a robot are, and where they are attached."""

    @abstractmethod
    def law(self, law: CableLaw) -> CableLaw:
        """The cables' numbers."""

    @abstractmethod
    def ends(self, offsets: Floats) -> Floats:
        """(2C, 3) where the cables end, in the frames of their bodies [m]."""


@dataclass(frozen=True)
class Families:
    """Effects, sorted by where they take hold."""

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
