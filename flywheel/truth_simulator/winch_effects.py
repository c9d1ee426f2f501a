"""Hidden effects between the commands and the rest lengths of the winched cables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.effect import WinchEffect
from flywheel.truth_simulator.scales import Scales


@dataclass(frozen=True)
class WinchBacklash(WinchEffect):
    """Total play b between motor and spool: the spool moves only when the play is used up."""

    name = "winch_backlash"
    units: ClassVar = {"width": "m"}
    width: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.01 * Scales.of(robot).length)

    def spool(self, motor: Floats, memory: Floats) -> Floats:
        return np.clip(memory, motor - self.width / 2, motor + self.width / 2)


@dataclass(frozen=True)
class CommandDelay(WinchEffect):
    """Commands act later; until the first one arrives the winches hold."""

    name = "command_delay"
    units: ClassVar = {"time": "s"}
    time: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.1 * Scales.of(robot).time)

    @property
    def delay(self) -> float:
        return self.time


@dataclass(frozen=True)
class ActuatorLag(WinchEffect):
    """First-order lag between the commanded and the real rate (or position)."""

    name = "actuator_lag"
    units: ClassVar = {"time": "s"}
    time: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.2 * Scales.of(robot).time)

    def follow(self, command: Floats, memory: Floats, step: float) -> tuple[Floats, Floats]:
        if self.time <= 0:
            return command, command
        done = -np.expm1(-step / self.time)
        gap = memory - command
        return command + gap * done * self.time / step, command + gap * (1 - done)


@dataclass(frozen=True)
class WinchGain(WinchEffect):
    """Winches that turn faster than commanded: rate (1 + g)."""

    name = "winch_gain"
    units: ClassVar = {"share": "-"}
    share: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.1)

    @property
    def gain(self) -> float:
        return 1.0 + self.share


@dataclass(frozen=True)
class TorqueSpeed(WinchEffect):
    """Motors that slow down under load: hauling in, the rate is r max(0, 1 - q T)."""

    name = "torque_speed"
    units: ClassVar = {"slope": "1/N"}
    slope: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.1 / Scales.of(robot).weight)

    def limit(self, rate: Floats, load: Floats, motor: Floats) -> Floats:
        return np.where(rate < 0, rate * np.maximum(0.0, 1.0 - self.slope * load), rate)
