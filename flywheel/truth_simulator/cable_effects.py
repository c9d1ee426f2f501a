"""Hidden effects in the cables: added tensions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.cable_law import CableLaw
from flywheel.truth_simulator.cable_motion import CableMotion
from flywheel.truth_simulator.effect import CableEffect
from flywheel.truth_simulator.scales import Scales
from flywheel.truth_simulator.skeleton import Skeleton, bare_spec


@dataclass(frozen=True)
class CableDamping(CableEffect):
    """Internal damping: dT = c V."""

    name = "cable_damping"
    units: ClassVar = {"damping": "N s/m"}
    damping: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        return cls(0.5 * s.weight * s.time / s.length)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        return self.damping * cables.rate, memory


@dataclass(frozen=True)
class CableFriction(CableEffect):
    """Coulomb friction of the same size at every tension: dT = F tanh(V / v0)."""

    name = "cable_friction"
    units: ClassVar = {"force": "N"}
    force: float
    slow: float  # v0 [m/s]

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        return cls(0.05 * s.weight, s.slow)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        return self.force * np.tanh(cables.rate / self.slow), memory


@dataclass(frozen=True)
class Capstan(CableEffect):
    """Friction over guides, in proportion to the tension: dT = mu T tanh(V / v0)."""

    name = "capstan"
    units: ClassVar = {"coefficient": "-"}
    coefficient: float
    slow: float  # v0 [m/s]

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.05, Scales.of(robot).slow)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        return self.coefficient * cables.tension * np.tanh(cables.rate / self.slow), memory


@dataclass(frozen=True)
class Hysteresis(CableEffect):
    """Dahl's friction, a spring that yields: dT = kh z, dz/dt = V - |V| z / d."""

    name = "hysteresis"
    units: ClassVar = {"stiffness": "N/m", "length": "m"}
    stiffness: float
    length: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        s = Scales.of(robot)
        length = 0.01 * s.length
        return cls(0.05 * s.weight / length, length)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        return self.stiffness * memory, bent(cables, memory, self.length)


@dataclass(frozen=True)
class Creep(CableEffect):
    """A standard linear solid: dT = a k x, dx/dt = de/dt - x / tau."""

    name = "creep"
    units: ClassVar = {"share": "-", "time": "s"}
    share: float
    time: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.15, 0.5 * Scales.of(robot).time)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        arm = relaxing(cables, memory, cables.rate - cables.rest_rate, self.time)
        return self.share * cables.stiffness * memory, arm


@dataclass(frozen=True)
class Stiffening(CableEffect):
    """Cables that stiffen as they stretch: dT = b T (e / l0)^2."""

    name = "stiffening"
    units: ClassVar = {"coefficient": "-"}
    coefficient: float

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.1)

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        strain = cables.extension / cables.rest
        return self.coefficient * cables.tension * strain**2, memory


@dataclass(frozen=True)
class WeakCable(CableEffect):
    """One cable that has lost a share of its stiffness: dT = -s T."""

    name = "weak_cable"
    units: ClassVar = {"share": "-"}
    share: float
    cable: int

    @classmethod
    def typical(cls, robot: Robot, rng: np.random.Generator) -> Self:
        return cls(0.2, drawn_cable(robot, rng))

    def extra(self, cables: CableMotion, memory: Floats) -> tuple[Floats, Floats]:
        added = np.zeros_like(cables.length)
        added[self.cable] = -self.share * cables.tension[self.cable]
        return added, memory


def bent(cables: CableMotion, memory: Floats, length: float) -> Floats:
    """(C,) Dahl's z one step later [m]; slack cables forget it.

    At a constant V, z approaches d sign(V) exponentially over the distance; hence exact per step.
    """
    final = length * np.sign(cables.rate)
    left = np.exp(-np.abs(cables.rate) * cables.step / length)
    return np.where(cables.taut, final + (memory - final) * left, 0.0)


def relaxing(cables: CableMotion, memory: Floats, speed: Floats, time: float) -> Floats:
    """(C,) stretch one step later of an arm that is drawn at a speed and relaxes [m]; exact per step."""
    gained = speed * time
    following = gained + (memory - gained) * np.exp(-cables.step / time)
    return np.where(cables.taut, following, 0.0)


def drawn_cable(robot: Robot, rng: np.random.Generator, winched: bool = False) -> int:
    """A loaded cable: at the keyframe it has at least a quarter of the strongest tension."""
    tension = keyframe_tension(robot)
    able = tension >= tension.max() / 4
    if winched:
        able &= np.array([cable.winch >= 0 for cable in robot.cables])
    return int(rng.choice(np.flatnonzero(able)))


def keyframe_tension(robot: Robot) -> Floats:
    """(C,) elastic tensions at the keyframe [N]."""
    model = bare_spec(robot).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = robot.keyframe.qpos
    mujoco.mj_fwdPosition(model, data)
    skeleton, law = Skeleton(robot, model), CableLaw.of(robot)
    length = skeleton.cables(data, np.zeros((len(robot.points), 3)))[2]
    return np.asarray(law.stiffness * np.maximum(length - law.rest, 0.0))
