"""Effects outside any diagnosis library: the right answer is "none of mine"."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.cable_effects import drawn_cable
from flywheel.truth_simulator.cable_motion import CableMotion
from flywheel.truth_simulator.effect import (
    BodyEffect,
    CableEffect,
    FlexEffect,
    RestEffect,
    WinchEffect,
    random_direction,
)
from flywheel.truth_simulator.scales import Scales

RECORDING = 3.0  # what "early" and "late" in a recording refer to [s]


@dataclass(frozen=True)
class Gust(BodyEffect):
    """A horizontal push on all bodies, by mass, that swells and fades like half a cosine wave."""

    name = "gust"
    units: ClassVar = {"x": "N", "y": "N", "begin": "s", "seconds": "s"}
    sized: ClassVar = ("x", "y")
    x: float
    y: float
    begin: float
    seconds: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        x, y = 0.1 * Scales.of(robot).weight * random_direction(rng, 2)
        begin, seconds = rng.uniform(0.1, 0.5) * RECORDING, rng.uniform(0.8, 1.2)
        return cls(float(x), float(y), float(begin), float(seconds))

    def force(self, time: float, velocity: Floats, mass: Floats) -> Floats:
        phase = np.clip((time - self.begin) / self.seconds, 0.0, 1.0)
        strength = 0.5 - 0.5 * np.cos(2 * np.pi * phase)
        share = mass / mass.sum()
        return np.asarray(strength * share[:, None] * np.array([self.x, self.y, 0.0]))


@dataclass(frozen=True)
class Cogging(WinchEffect):
    """Rates that ripple with the motor's position m: r (1 + A sin(2 pi m / p))."""

    name = "cogging"
    units: ClassVar = {"ripple": "-", "pitch": "m"}
    ripple: float
    pitch: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.4, 0.05 * Scales.of(robot).length)

    def limit(self, rate: Floats, load: Floats, motor: Floats) -> Floats:
        return rate * (1.0 + self.ripple * np.sin(2 * np.pi * motor / self.pitch))


@dataclass(frozen=True)
class CableSlip(RestEffect):
    """One winched cable slips on its spool, once."""

    name = "cable_slip"
    units: ClassVar = {"length": "m", "begin": "s"}
    length: float
    begin: float
    cable: int

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        cable = drawn_cable(robot, rng, winched=True)
        begin = rng.uniform(0.1, 0.5) * RECORDING
        return cls(0.02 * Scales.of(robot).length, float(begin), cable)

    def added(self, time: float, cables: int) -> Floats:
        added = np.zeros(cables)
        added[self.cable] = self.length if time >= self.begin else 0.0
        return added


@dataclass(frozen=True)
class QuadraticDamping(CableEffect):
    """Damping that grows with the square of the rate: dT = c V |V|."""

    name = "quadratic_damping"
    units: ClassVar = {"damping": "N s^2/m^2"}
    damping: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        return cls(5.0 * s.weight * (s.time / s.length) ** 2)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        return self.damping * cables.rate * np.abs(cables.rate), memory


@dataclass(frozen=True)
class StiffnessDrift(CableEffect):
    """Cables that soften during the recording, by a total fraction."""

    name = "stiffness_drift"
    units: ClassVar = {"share": "-", "seconds": "s"}
    share: float
    seconds: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.2, RECORDING)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        lost = self.share * np.clip(cables.time / self.seconds, 0.0, 1.0)
        return -lost * cables.tension, memory


@dataclass(frozen=True)
class RodFlex(FlexEffect):
    """Bodies whose ends bend and compress under the cables, like a spring and a damper in parallel.

    A tracked point, with the adjacent cable ends, moves by u in the frame of its body: du/dt = (q F
    - u) / tau, F being the sum of those cables' forces. Mass, inertia and the contact place of the
    cap stay those of the straight rod.
    """

    name = "rod_flex"
    units: ClassVar = {"compliance": "m/N", "time": "s"}
    compliance: float
    time: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        return cls(0.005 * s.length / s.weight, 0.05 * s.time)

    def bend(self, load: Floats, memory: Floats, step: float) -> Floats:
        final = self.compliance * load
        return np.asarray(final + (memory - final) * np.exp(-step / self.time))
