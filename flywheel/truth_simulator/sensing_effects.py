"""Hidden effects of the sensors, without influence on the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.effect import SensingEffect, random_direction
from flywheel.truth_simulator.scales import Scales


@dataclass(frozen=True)
class MarkerOffset(SensingEffect):
    """One marker attached beside its tracked point, by (x, y, z) in the frame of its body."""

    name = "marker_offset"
    units: ClassVar = {"x": "m", "y": "m", "z": "m"}
    sized: ClassVar = ("x", "y", "z")
    x: float
    y: float
    z: float
    point: int

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        x, y, z = 0.01 * Scales.of(robot).length * random_direction(rng, 3)
        return cls(float(x), float(y), float(z), int(rng.integers(len(robot.points))))

    def offset(self, robot: Robot) -> Floats:
        offsets = np.zeros((len(robot.points), 3))
        offsets[self.point] = self.x, self.y, self.z
        return offsets


@dataclass(frozen=True)
class SensorLatency(SensingEffect):
    """Positions are measured late."""

    name = "sensor_latency"
    units: ClassVar = {"time": "s"}
    time: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.1 * Scales.of(robot).time)

    @property
    def latency(self) -> float:
        return self.time
