"""Effects on the tension of cables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import mujoco
import numpy as np

from flywheel.effects.effect import (
    RESTS,
    Cables,
    Memory,
    ModelEffect,
    Numbers,
    Parameter,
    TensionEffect,
    Values,
)
from flywheel.records import Floats
from flywheel.robots import Robot

SHORTEST = 1e-3  # [m]: a simulation that diverged begins anew with cables of no length at all


class CableDamping(TensionEffect):
    """Cables with more damping than in the MJCF: viscous damping of taut cables, in addition to the
    MJCF's.
    """

    name = "cable_damping"
    sizes = (Parameter("damping", "N s/m", lambda s: 0.5 * s.weight * s.time / s.length, low=-2.0),)
    equation = "dT = c V"
    source = "Kelvin-Voigt element"
    shown_by = "fast strokes of all winches"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["damping"] * cables.speed, memory


class CableFriction(TensionEffect):
    """Friction of every moving cable: a constant Coulomb force against its motion."""

    name = "cable_friction"
    sizes = (Parameter("force", "N", lambda s: 0.05 * s.weight),)
    equation = "dT = F tanh(V / v0)"
    source = "Coulomb's law, smooth below v0 = 0.01 L / sqrt(L / g)"
    shown_by = "slow strokes to and fro at one pretension"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["force"] * cables.direction, memory


class Capstan(TensionEffect):
    """A cable that rubs around its guide: friction grows with the tension."""

    name = "capstan"
    sizes = (Parameter("coefficient", "-", lambda s: 0.05, high=10.0),)
    equation = "dT = mu T tanh(V / v0)"
    source = "Euler-Eytelwein, exp(mu theta) - 1 for small angles"
    shown_by = "the same strokes at low and at high pretension"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        return values["coefficient"] * cables.elastic * cables.direction, memory


class Hysteresis(TensionEffect):
    """Cables whose tension depends on their history: Dahl's rate-independent friction.

    It is stiff for small strokes and constant for long ones.
    """

    name = "hysteresis"
    sizes = (Parameter("force", "N", lambda s: 0.05 * s.weight),)
    shapes = (Parameter("length", "m", lambda s: 0.01 * s.length, 0.05, 20.0, (0.4, 1.0, 2.5)),)
    equation = "dT = F z / d, dz/dt = V - |V| z / d"
    source = "P. Dahl, A solid friction model, 1968"
    shown_by = "small strokes to and fro, of a growing amplitude"
    remembers = True

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        length = np.maximum(values["length"], 1e-9)
        bent = np.where(cables.taut, memory, 0.0)
        # exact over a step of constant speed: z moves towards +-d over a way of d
        way = cables.speed * cables.dt
        goal = np.sign(way) * length
        return values["force"] * bent / length, goal + (bent - goal) * np.exp(-np.abs(way) / length)


class Creep(TensionEffect):
    """Standard linear solid: a spring and damper in series, parallel to the cable's spring.

    The memory is the extension of the series spring: x = e - y, where y follows the extension e
    with the time constant tau, so that a quick stretch is resisted more than a slow one.
    """

    name = "creep"
    sizes = (Parameter("share", "-", lambda s: 0.15, high=10.0),)
    shapes = (Parameter("time", "s", lambda s: 0.5 * s.time, 0.05, 20.0, (0.3, 1.0, 3.0)),)
    winch_kinds = RESTS
    equation = "dT = a k x, dx/dt = de/dt - x / tau"
    source = "Zener's model"
    shown_by = "a step of all winches, then holding still"
    remembers = True

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        # memory is y, the part of the extension that has relaxed; a slack cable starts anew
        extension = np.where(cables.taut, cables.extension, 0.0)
        relaxed = np.where(cables.taut, np.where(memory == 0.0, extension, memory), 0.0)
        arm = extension - relaxed
        decay = np.exp(-cables.dt / np.maximum(values["time"], 1e-9))
        return values["share"] * cables.stiffness * arm, extension - arm * decay


class Stiffening(TensionEffect):
    """Cables that get stiffer the more they are stretched: a cubic spring."""

    name = "stiffening"
    sizes = (Parameter("coefficient", "-", lambda s: 0.1, low=-5.0),)
    winch_kinds = RESTS
    equation = "dT = b T (e / l0)^2"
    source = "Duffing's spring"
    shown_by = "high against low pretension, slowly"
    power: ClassVar[int] = 2  # of the strain

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        strain = cables.extension / np.maximum(cables.rest, SHORTEST)
        return values["coefficient"] * cables.elastic * strain**self.power, memory


class WeakCable(ModelEffect):
    """One cable softer than the others of its kind: a fraction of its stiffness is missing."""

    name = "weak_cable"
    where = "cable"
    sizes = (Parameter("share", "-", lambda s: 0.2, low=-5.0, high=4.9),)
    winch_kinds = RESTS
    equation = "dT = -s T at one cable"
    source = "Hooke's law"
    shown_by = "strokes that load the cables one after the other"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        assert place is not None
        _scale_stiffness(model, np.array([place]), 1.0 - values["share"])


class CableStiffness(ModelEffect):
    """Cables stiffer or softer than in the MJCF, all by the same fraction."""

    name = "cable_stiffness"
    sizes = (Parameter("share", "-", lambda s: 0.05, low=-19.0, high=380.0),)
    winch_kinds = RESTS
    equation = "k (1 + s) of every cable"
    source = "Hooke's law"
    shown_by = "slow strokes of all winches"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        _scale_stiffness(model, np.arange(len(robot.cables)), 1.0 + values["share"])


def pulls_on(model: mujoco.MjModel, cables: Sequence[int] | np.ndarray) -> np.ndarray:
    """(actuators,) bool: True for MuJoCo's actuators on these cables."""
    on_tendon = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    own = np.equal.outer(model.actuator_trnid[:, 0], cables).any(axis=1)
    return np.asarray(on_tendon & own)


def _scale_stiffness(model: mujoco.MjModel, cables: np.ndarray, factor: float) -> None:
    """Multiply the stiffness of the cables (n,) given by index, and of the winches that pull on them."""
    model.tendon_stiffness[cables] *= factor
    model.tendon_stiffnesspoly[cables] *= factor
    pulls = pulls_on(model, cables) & (model.actuator_biasprm[:, 1] != 0)  # others take tensions
    model.actuator_gainprm[pulls, 0] *= factor
    model.actuator_biasprm[pulls, :2] *= factor
