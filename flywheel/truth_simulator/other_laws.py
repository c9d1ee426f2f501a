"""Hidden effects in another form than the library's, and laws unlike any in the library.

`OTHER_FORMS` are physical causes that a diagnosis can name, but with another law, e.g. friction in
proportion to each cable's stiffness. Their family should be named; some of these laws are other
forms of effects of the library. `UNKNOWN_LAWS` have no candidate. None of these may ever be added
to the library, because the examination needs laws outside of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.cable_effects import bent, drawn_cable, relaxing
from flywheel.truth_simulator.cable_motion import CableMotion
from flywheel.truth_simulator.effect import (
    BodyEffect,
    CableEffect,
    HiddenEffect,
    WinchEffect,
    random_direction,
)
from flywheel.truth_simulator.outside import RECORDING
from flywheel.truth_simulator.scales import Scales

UNEQUAL = 0.7  # standard deviation of the logarithm of what differs from cable to cable


class OtherForm(HiddenEffect):
    """An effect that the library can name, but with another law.

    Attributes:
      family: that name.
    """

    family: ClassVar[str]


@dataclass(frozen=True)
class FrictionByStiffness(OtherForm, CableEffect):
    """Coulomb friction in proportion to each cable's stiffness: dT = d k tanh(V / v0)."""

    name = "friction_by_stiffness"
    family = "cable_friction"
    units: ClassVar = {"stretch": "m"}
    stretch: float
    slow: float  # v0 [m/s]

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        stiffness = float(np.mean([cable.stiffness for cable in robot.cables]))
        return cls(0.05 * s.weight / stiffness, s.slow)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        return self.stretch * cables.stiffness * np.tanh(cables.rate / self.slow), memory


@dataclass(frozen=True)
class FrictionByCable(OtherForm, CableEffect):
    """Coulomb friction that differs from cable to cable: dT = F_c tanh(V / v0)."""

    name = "friction_by_cable"
    family = "cable_friction"
    units: ClassVar = {"force": "N"}
    force: float  # the middle one
    shares: tuple[float, ...]
    slow: float  # v0 [m/s]

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        shares = np.exp(UNEQUAL * rng.normal(size=len(robot.cables)))
        return cls(0.05 * s.weight, tuple(shares.tolist()), s.slow)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        return self.force * np.array(self.shares) * np.tanh(cables.rate / self.slow), memory


@dataclass(frozen=True)
class HysteresisByStiffness(OtherForm, CableEffect):
    """Dahl's friction in proportion to each cable's stiffness: dT = h k z, dz/dt = V - |V| z / d."""

    name = "hysteresis_by_stiffness"
    family = "hysteresis"
    units: ClassVar = {"share": "-", "length": "m"}
    share: float
    length: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        length = 0.01 * s.length
        stiffness = float(np.mean([cable.stiffness for cable in robot.cables]))
        return cls(0.05 * s.weight / length / stiffness, length)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        return self.share * cables.stiffness * memory, bent(cables, memory, self.length)


@dataclass(frozen=True)
class CreepOnLength(OtherForm, CableEffect):
    """A relaxing arm on the motion of the cable, not on its stretch: dT = a k x, dx/dt = V - x / tau."""

    name = "creep_on_length"
    family = "creep"
    units: ClassVar = {"share": "-", "time": "s"}
    share: float
    time: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.15, 0.5 * Scales.of(robot).time)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        arm = relaxing(cables, memory, cables.rate, self.time)
        return self.share * cables.stiffness * memory, arm


@dataclass(frozen=True)
class StiffeningFromTheStart(OtherForm, CableEffect):
    """Cables that stiffen with the first power of their strain: dT = b T (e / l0)."""

    name = "stiffening_from_the_start"
    family = "stiffening"
    units: ClassVar = {"coefficient": "-"}
    coefficient: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.1)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        strain = np.maximum(cables.extension, 0.0) / cables.rest
        return self.coefficient * cables.tension * strain, memory


@dataclass(frozen=True)
class GainByWinch(OtherForm, WinchEffect):
    """Winches that turn faster than commanded, each by a different fraction: rate (1 + g_w)."""

    name = "gain_by_winch"
    family = "winch_gain"
    units: ClassVar = {"share": "-"}
    share: float  # the middle one
    shares: tuple[float, ...]

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        shares = np.exp(UNEQUAL * rng.normal(size=len(robot.winches)))
        return cls(0.1, tuple(shares.tolist()))

    def limit(self, rate: Floats, load: Floats, motor: Floats) -> Floats:
        return rate * (1.0 + self.share * np.array(self.shares))


@dataclass(frozen=True)
class BacklashOfOneWinch(OtherForm, WinchEffect):
    """Play between motor and spool of one winch alone."""

    name = "backlash_of_one_winch"
    family = "winch_backlash"
    units: ClassVar = {"width": "m"}
    width: float
    winch: int

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.02 * Scales.of(robot).length, int(rng.integers(len(robot.winches))))

    def spool(self, motor: Floats, memory: Floats) -> Floats:
        play = np.zeros_like(motor)
        play[self.winch] = self.width / 2
        return np.clip(memory, motor - play, motor + play)


@dataclass(frozen=True)
class LagByDirection(OtherForm, WinchEffect):
    """A lag of the motors that is three times as long when they speed up as when they slow down."""

    name = "lag_by_direction"
    family = "actuator_lag"
    units: ClassVar = {"time": "s"}
    time: float  # when they slow down

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.1 * Scales.of(robot).time)

    def follow(self, command: Floats, memory: Floats, step: float) -> tuple[Floats, Floats]:
        if self.time <= 0:
            return command, command
        time = np.where(np.abs(command) > np.abs(memory), 3.0 * self.time, self.time)
        done, gap = -np.expm1(-step / time), memory - command
        return command + gap * done * time / step, command + gap * (1 - done)


@dataclass(frozen=True)
class QuadraticDrag(OtherForm, BodyEffect):
    """Drag with the square of the speed: a force -c |v| v at the centre of mass of each body."""

    name = "quadratic_drag"
    family = "air_drag"
    units: ClassVar = {"drag": "N s^2/m^2"}
    drag: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        return cls(2.0 * s.weight * (s.time / s.length) ** 2 / s.bodies)

    def force(self, time: float, velocity: Floats, mass: Floats) -> Floats:
        return -self.drag * np.linalg.norm(velocity, axis=1, keepdims=True) * velocity


@dataclass(frozen=True)
class Stribeck(CableEffect):
    """Friction that is stronger at rest than in motion: dT = F (1 + 2 exp(-(V / vs)^2)) tanh(V / v0)."""

    name = "stribeck"
    units: ClassVar = {"force": "N"}
    force: float
    slow: float  # v0; vs is ten times that [m/s]

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        return cls(0.05 * s.weight, s.slow)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        sticking = 1.0 + 2.0 * np.exp(-((cables.rate / (10.0 * self.slow)) ** 2))
        return self.force * sticking * np.tanh(cables.rate / self.slow), memory


@dataclass(frozen=True)
class BoucWen(CableEffect):
    """Hysteresis that hardens on the way back: dT = kh z, dz/dt = V - (b |V| z + c V |z|) / d, b > c."""

    name = "bouc_wen"
    units: ClassVar = {"stiffness": "N/m", "length": "m"}
    stiffness: float
    length: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        length = 0.03 * s.length
        return cls(0.08 * s.weight / length, length)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        bound = (
            0.8 * np.abs(cables.rate) * memory - 0.5 * cables.rate * np.abs(memory)
        ) / self.length
        following = memory + cables.step * (cables.rate - bound)
        return self.stiffness * memory, np.where(cables.taut, following, 0.0)


@dataclass(frozen=True)
class SlackFirst(CableEffect):
    """Cables whose first stretch takes up slack: up to it they have a fifth of their stiffness."""

    name = "slack_first"
    units: ClassVar = {"stretch": "m"}
    stretch: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.01 * Scales.of(robot).length)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        taken = np.clip(cables.extension, 0.0, self.stretch)
        return -0.8 * cables.stiffness * taken, memory


@dataclass(frozen=True)
class Warming(CableEffect):
    """Cables that soften with work: dT = -s T (1 - exp(-E / E0)), E being the work done so far."""

    name = "warming"
    units: ClassVar = {"share": "-", "energy": "J"}
    share: float
    energy: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        return cls(0.2, 0.2 * s.weight * s.length)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        lost = self.share * -np.expm1(-memory / self.energy)
        return -lost * cables.tension, memory + cables.step * np.abs(cables.tension * cables.rate)


@dataclass(frozen=True)
class Yielding(CableEffect):
    """One cable with plastic elongation under high load: its longest stretch leaves a tenth."""

    name = "yielding"
    units: ClassVar = {"share": "-"}
    share: float
    cable: int

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.1, drawn_cable(robot, rng))

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        added, longest = np.zeros_like(cables.length), np.maximum(memory, cables.extension)
        lost = self.share * cables.stiffness * longest
        added[self.cable] = -min(lost[self.cable], cables.tension[self.cable])
        return added, longest


@dataclass(frozen=True)
class Sag(CableEffect):
    """Heavy cables, which sag, and pull less than straight ones: dT = -T / (1 + (T / T0)^2)."""

    name = "sag"
    units: ClassVar = {"force": "N"}
    force: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.2 * Scales.of(robot).weight)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        if not self.force:
            return np.zeros_like(cables.length), memory
        return -cables.tension / (1.0 + (cables.tension / self.force) ** 2), memory


@dataclass(frozen=True)
class DeadBand(WinchEffect):
    """Motors that do not turn for small commands: those below a fraction of the largest are ignored."""

    name = "dead_band"
    units: ClassVar = {"rate": "m/s"}
    rate: float

    @classmethod
    def applies(cls, robot: Robot) -> bool:
        return bool(robot.rate_driven.all())

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.25 * float(np.abs(robot.control_high).max()))

    def follow(self, command: Floats, memory: Floats, step: float) -> tuple[Floats, Floats]:
        return np.where(np.abs(command) > self.rate, command, 0.0), memory


@dataclass(frozen=True)
class SlowHauling(WinchEffect):
    """Motors that haul in more slowly than they pay out, at any load."""

    name = "slow_hauling"
    units: ClassVar = {"share": "-"}
    share: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.15)

    def limit(self, rate: Floats, load: Floats, motor: Floats) -> Floats:
        return np.where(rate < 0, rate * (1.0 - self.share), rate)


@dataclass(frozen=True)
class SideWind(BodyEffect):
    """A steady horizontal force on all bodies, by mass, for a quarter of the recording."""

    name = "side_wind"
    units: ClassVar = {"x": "N", "y": "N", "begin": "s"}
    sized: ClassVar = ("x", "y")
    x: float
    y: float
    begin: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        x, y = 0.06 * Scales.of(robot).weight * random_direction(rng, 2)
        return cls(float(x), float(y), float(rng.uniform(0.1, 0.6) * RECORDING))

    def force(self, time: float, velocity: Floats, mass: Floats) -> Floats:
        blows = self.begin <= time < self.begin + RECORDING / 4
        share = mass / mass.sum()
        return np.asarray(blows * share[:, None] * np.array([self.x, self.y, 0.0]))


OTHER_FORMS: dict[str, type[OtherForm]] = {
    kind.name: kind
    for kind in (
        FrictionByStiffness,
        FrictionByCable,
        HysteresisByStiffness,
        CreepOnLength,
        StiffeningFromTheStart,
        GainByWinch,
        BacklashOfOneWinch,
        LagByDirection,
        QuadraticDrag,
    )
}
UNKNOWN_LAWS: dict[str, type[HiddenEffect]] = {
    kind.name: kind
    for kind in (
        Stribeck,
        BoucWen,
        SlackFirst,
        Warming,
        Yielding,
        Sag,
        DeadBand,
        SlowHauling,
        SideWind,
    )
}
