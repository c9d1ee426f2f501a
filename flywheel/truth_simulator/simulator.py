"""The truth simulator: one robot with hidden effects, a plain loop over small steps.

It is another implementation of the same physics as `flywheel.dynamics.plant`, on purpose: cables and
winches are worked out here and not by MuJoCo, the time step is a fifth, the contact solver is another,
and it shares no code with the library of effects. A diagnosis that explains its recordings has not been
graded with its own answer key.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields

import mujoco
import numpy as np

from flywheel.errors import ModelError
from flywheel.records import Floats, State
from flywheel.registry import lookup
from flywheel.robots import Robot
from flywheel.robots.mujoco_warnings import collected_warnings
from flywheel.truth_simulator.cable_law import CableLaw
from flywheel.truth_simulator.cable_motion import CableMotion
from flywheel.truth_simulator.contact import CONTACTS, Contact, PenaltyGround
from flywheel.truth_simulator.effect import Families, HiddenEffect
from flywheel.truth_simulator.motors import Motors
from flywheel.truth_simulator.skeleton import Skeleton, bare_spec

STEP = 0.001  # [s]
SETTLE = 2.0  # [s]


@dataclass(frozen=True)
class HiddenMotion:
    """The true motion, noise-free: at one moment, or at the T + 1 before and after each control (`...`).

    Attributes:
      points: (..., P, 3) true tracked points [m].
      seen: (..., P, 3) visible positions of the markers, with offset and latency [m].
      motor: (..., W) motor positions, as length paid out [m].
      rest: (..., C) rest lengths of the cables [m].
      tension: (..., C) [N].
      energy: (...,) kinetic, of height, and of the cables' springs [J].
    """

    points: Floats
    seen: Floats
    motor: Floats
    rest: Floats
    tension: Floats
    energy: Floats


class TruthSimulator:
    """Simulates a robot with hidden effects.

    Args:
      robot: any robot this project can read.
      effects: any number; the order matters only between effects on the same command.
      contact: "elliptic" or "pyramidal" (MuJoCo's cones, by the CG solver), or "penalty" (our own
        springs). The first is nearest to the MJCF's own contact: without effects it stays within
        0.02 % of the robot's length of a plant of the same time step for a second of commands; the
        others deviate by 0.2 to 0.5 %.
      step: time step [s].

    Raises:
      UnknownNameError: no such kind of contact.
      ModelError: cables are not linear.
    """

    def __init__(
        self,
        robot: Robot,
        effects: Sequence[HiddenEffect] = (),
        contact: Contact = "elliptic",
        step: float = STEP,
    ) -> None:
        robot.require_even_winches("simulated by the truth simulator")
        self._cone = lookup(CONTACTS, contact, "contact")
        self.robot, self.effects, self.contact, self.step = robot, tuple(effects), contact, step
        self.families = Families.of(self.effects)
        self.law = CableLaw.of(robot)
        for effect in self.families.build:
            self.law = effect.law(self.law)
        self.model = self._compile()

    def _compile(self) -> mujoco.MjModel:
        spec = bare_spec(self.robot, self.families.model)
        option = spec.option
        option.timestep = self.step
        option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        option.cone = self._cone
        option.solver = mujoco.mjtSolver.mjSOL_CG
        option.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        return spec.compile()

    def run(
        self, controls: Floats, dt: float, start: State | None = None, settle: float = SETTLE
    ) -> HiddenMotion:
        """Settle with holding winches, then execute the controls.

        Args:
          controls: (T, W) commands, T >= 1; clipped to the winches' ranges.
          dt: duration of each [s], a multiple of the step.
          start: (unbatched) state to settle from; the keyframe if None.
          settle: duration [s]; 0 to start at once.

        Raises:
          ModelError: shapes or times do not fit, a penalty contact is impossible on the ground, or
            a simulation diverged.
        """
        controls = np.asarray(controls, float)
        if controls.ndim != 2 or controls.shape[1] != len(self.robot.winches) or not len(controls):
            raise ModelError(
                f"{self.robot.name} takes controls (T, {len(self.robot.winches)}) with T >= 1, got "
                f"{controls.shape}."
            )
        moving = self.begin(dt, start, settle)
        moments = [moving.look()]
        for control in controls:
            moving.go(control)
            moments.append(moving.look())
        return HiddenMotion(
            *(np.array([getattr(m, f.name) for m in moments]) for f in fields(HiddenMotion))
        )

    def begin(self, dt: float, start: State | None = None, settle: float = SETTLE) -> Simulation:
        """The robot at rest, to be commanded step by step.

        Args:
          dt: duration of each command [s], a multiple of the step.
          start: (unbatched) state to settle from; the keyframe if None.
          settle: duration, with holding winches [s].

        Raises:
          ModelError: times do not fit, a penalty contact is impossible on the ground, or a
            simulation diverged.
        """
        every = round(dt / self.step)
        if every < 1 or not np.isclose(every * self.step, dt, rtol=1e-9):
            raise ModelError(f"dt {dt:g} s must be a multiple of the time step, {self.step:g} s.")
        return Simulation(self, dt, start or self.robot.keyframe, round(settle / self.step))


class Simulation:
    """A simulated robot that is commanded step by step: `look` at it, then let it `go` on.

    Args:
      sim: the simulator.
      dt: duration of each command [s].
      start: (unbatched) state to settle from.
      settling: number of time steps.
    """

    def __init__(self, sim: TruthSimulator, dt: float, start: State, settling: int) -> None:
        robot, self.sim, self._every = sim.robot, sim, round(dt / sim.step)
        self.model = sim.model.__copy__()  # a penalty contact changes it
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:], self.data.qvel[:] = start.qpos, start.qvel
        self.skeleton = Skeleton(robot, self.model)
        for built in sim.families.build:
            self.skeleton.end_offset = built.ends(self.skeleton.end_offset)
        springs = sim.contact == "penalty"
        self.ground = PenaltyGround(robot, self.model, self.skeleton) if springs else None
        self.effects = effects = sim.families
        self.motors = Motors(
            robot, robot.winch_of(start), dt, sim.step, effects.winch, effects.rest
        )
        self.memories: list[Floats] = [np.zeros(len(robot.cables)) for _ in effects.cable]
        self.bends: list[Floats] = [np.zeros((len(robot.points), 3)) for _ in effects.flex]
        self.offset: Floats = np.zeros((len(robot.points), 3))
        for effect in effects.sensing:
            self.offset = self.offset + effect.offset(robot)
        self.rest = self.motors.rest(-np.inf)
        self._late = sum(effect.latency for effect in effects.sensing) / sim.step
        self._seen: deque[Floats] = deque(maxlen=int(np.ceil(self._late)) + 2)
        self._settling, self._index = settling, -settling
        with collected_warnings():
            self._present = self._sense()
            for _ in range(settling):
                self._move()

    @property
    def time(self) -> float:
        """Time since the robot was at rest [s]."""
        return self._index * self.sim.step

    def look(self) -> HiddenMotion:
        """The true motion at this moment.

        Raises:
          ModelError: the simulation diverged.
        """
        now, data = self._present, self.data
        points = self.skeleton.points(data, now.bent)
        diverged = data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number
        if not np.isfinite(points).all() or diverged:
            raise ModelError(f"{self.sim.robot.name} diverged before {self.time:.3f} s.")
        cables = now.cables
        spring = 0.5 * (cables.tension * np.maximum(cables.extension, 0.0)).sum()
        return HiddenMotion(
            points=points,
            seen=self._seen_late(),
            motor=self.motors.position.copy(),
            rest=cables.rest,
            tension=now.tension,
            energy=np.asarray(data.energy.sum() + spring),
        )

    def go(self, control: Floats) -> None:
        """Execute one command (W,) for its duration; it is clipped to the winches' ranges."""
        self.motors.hear(control)
        with collected_warnings():
            for _ in range(self._every):
                self._move()

    def _sense(self) -> _Present:
        """The configuration at the start of a step, before forces."""
        data, skeleton, sim = self.data, self.skeleton, self.sim
        mujoco.mj_step1(self.model, data)
        bent = np.zeros_like(self.offset)
        for bend in self.bends:
            bent = bent + bend
        ends, along, length, rate = skeleton.cables(data, bent)
        rest = self.motors.rest(self.time)
        cables = CableMotion(
            self.time,
            sim.step,
            length,
            rate,
            rest,
            (rest - self.rest) / sim.step,
            sim.law.stiffness,
        )
        self.rest = rest
        tension = self._tension(cables)
        self._seen.append(skeleton.points(data, bent + self.offset))
        return _Present(bent, ends, along, cables, tension)

    def _move(self) -> None:
        """Apply forces, and advance by one time step."""
        data, skeleton, now, step = self.data, self.skeleton, self._present, self.sim.step
        data.xfrc_applied[:] = 0.0
        force = skeleton.pull(data, now.ends, now.along, now.tension)
        self._push(self.time)
        if self.bends:
            loads = skeleton.point_loads(data, force)
            flexes = zip(self.effects.flex, self.bends, strict=True)
            self.bends = [flex.bend(loads, bend, step) for flex, bend in flexes]
        self.motors.advance(self.time, now.cables.tension)
        mujoco.mj_step2(self.model, data)
        self._index += 1
        self._present = self._sense()

    def _tension(self, cables: CableMotion) -> Floats:
        extra = np.zeros_like(cables.length)
        for i, effect in enumerate(self.effects.cable):
            added, self.memories[i] = effect.extra(cables, self.memories[i])
            extra = extra + added
        return self.sim.law.tension(cables, extra)

    def _push(self, time: float) -> None:
        data, skeleton = self.data, self.skeleton
        if self.ground:
            self.ground.push(data, self.sim.step)
        for effect in self.effects.body:
            centre = data.xipos[skeleton.bodies]
            velocity = skeleton.velocity(data, skeleton.bodies, centre)
            force = effect.force(time, velocity, skeleton.mass)
            skeleton.push(data, skeleton.bodies, centre, force)

    def _seen_late(self) -> Floats:
        """Visible positions, interpolated linearly between the time steps."""
        present = self._settling + self._index
        wanted = max(present - self._late, 0.0)
        low = int(np.floor(wanted))
        share = wanted - low
        seen, newest = self._seen, len(self._seen) - 1
        high = min(low + 1, present)
        return np.asarray(
            (1 - share) * seen[newest + low - present] + share * seen[newest + high - present]
        )


@dataclass(frozen=True)
class _Present:
    """State at the start of a time step: bends (P, 3), cables' ends (2C, 3), directions (C, 3),
    pulls (C,).
    """

    bent: Floats
    ends: Floats
    along: Floats
    cables: CableMotion
    tension: Floats
