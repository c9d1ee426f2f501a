"""The truth simulator: one robot, one recording, hidden effects, a plain loop over small steps.

It is another implementation of the same physics as `flywheel.dynamics.plant`, on purpose: cables and
winches are worked out here and not by MuJoCo, the time step is a fifth, the integrator and the contact
solver are others, and it shares no code with the library of effects. A diagnosis that explains its
recordings has not been graded with its own answer key.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from flywheel.errors import ModelError
from flywheel.records import Floats, State
from flywheel.registry import lookup
from flywheel.robots import Robot
from flywheel.robots.mujoco_warnings import collected_warnings
from flywheel.truth_simulator.cable_law import CableLaw
from flywheel.truth_simulator.contact import CONTACTS, Contact, PenaltyGround
from flywheel.truth_simulator.effect import CableMotion, Families, HiddenEffect
from flywheel.truth_simulator.motors import Motors
from flywheel.truth_simulator.skeleton import Skeleton, bare_spec

STEP = 0.001  # [s]
SETTLE = 2.0  # [s]
DIVERGED = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


@dataclass(frozen=True)
class HiddenMotion:
    """What happened, noise-free, at the T + 1 moments before and after each control.

    Attributes:
      points: (T + 1, P, 3) tracked points, where they are [m].
      seen: (T + 1, P, 3) where the markers look to be, with offset and latency [m].
      motor: (T + 1, W) motor positions, as length paid out [m].
      rest: (T + 1, C) rest lengths of the cables [m].
      tension: (T + 1, C) [N].
      energy: (T + 1,) kinetic, of height, and of the cables' springs [J].
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
      contact: "elliptic" or "pyramidal" (MuJoCo's cones, by the CG solver), or "penalty" (springs of
        our own). The first is nearest to the MJCF's own contact: without effects it stays within
        0.02 % of the robot's length of a plant of the same time step for a second of commands; the
        others part by 0.2 to 0.5 %.
      step: time step [s].

    Raises:
      UnknownNameError: no such kind of contact.
      ModelError: cables that are not linear.
    """

    def __init__(
        self,
        robot: Robot,
        effects: Sequence[HiddenEffect] = (),
        contact: Contact = "elliptic",
        step: float = STEP,
    ) -> None:
        self._cone = lookup(CONTACTS, contact, "contact")
        self.robot, self.effects, self.contact, self.step = robot, tuple(effects), contact, step
        self.families = Families.of(self.effects)
        self.law = CableLaw.of(robot)
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
        self,
        controls: Floats,
        dt: float,
        start: State | None = None,
        settle: float = SETTLE,
    ) -> HiddenMotion:
        """Settle with the winches holding, then carry out the controls.

        Args:
          controls: (T, W) commands, T >= 1; clipped to the winches' ranges.
          dt: how long each lasts [s], a multiple of the step.
          start: (unbatched) state to settle from; the keyframe if None.
          settle: how long [s]; 0 to begin at once.

        Raises:
          ModelError: shapes or times that do not fit, a ground that a penalty contact cannot be, or a
            simulation that diverged.
        """
        every = round(dt / self.step)
        if every < 1 or not np.isclose(every * self.step, dt, rtol=1e-9):
            raise ModelError(f"dt {dt:g} s must be a multiple of the time step, {self.step:g} s.")
        controls = np.asarray(controls, float)
        if controls.ndim != 2 or controls.shape[1] != len(self.robot.winches) or not len(controls):
            raise ModelError(
                f"{self.robot.name} takes controls (T, {len(self.robot.winches)}) with T >= 1, got "
                f"{controls.shape}."
            )
        course = _Course(self, controls, dt, start or self.robot.keyframe)
        before = round(settle / self.step)
        with collected_warnings():
            for index in range(-before, every * len(controls) + 1):
                course.step(index * self.step, log=index >= 0 and index % every == 0)
        return course.motion(before, every)


class _Course:
    """One run of the simulator: everything that changes while it goes on."""

    def __init__(self, sim: TruthSimulator, controls: Floats, dt: float, start: State) -> None:
        robot, self.sim = sim.robot, sim
        model = sim.model.__copy__()  # a penalty contact changes it
        self.model, self.data = model, mujoco.MjData(model)
        self.data.qpos[:], self.data.qvel[:] = start.qpos, start.qvel
        self.skeleton = Skeleton(robot, model)
        springs = sim.contact == "penalty"
        self.ground = PenaltyGround(robot, model, self.skeleton) if springs else None
        self.effects = effects = sim.families
        held = robot.winch_of(start)
        self.motors = Motors(robot, held, controls, dt, sim.step, effects.winch, effects.rest)
        self.memories: list[Floats] = [np.zeros(len(robot.cables)) for _ in effects.cable]
        self.bends: list[Floats] = [np.zeros((len(robot.points), 3)) for _ in effects.flex]
        self.offset: Floats = np.zeros((len(robot.points), 3))
        for effect in effects.sensing:
            self.offset = self.offset + effect.offset(robot)
        self.rest = self.motors.rest(-np.inf)
        self.seen: list[Floats] = []
        self.log: list[tuple[Floats, ...]] = []

    def step(self, time: float, log: bool) -> None:
        """Look, pull, and move on by one step."""
        data, skeleton, sim = self.data, self.skeleton, self.sim
        mujoco.mj_step1(self.model, data)
        bent = np.zeros_like(self.offset)
        for bend in self.bends:
            bent = bent + bend
        ends, along, length, rate = skeleton.cables(data, bent)
        rest = self.motors.rest(time)
        cables = CableMotion(
            time, sim.step, length, rate, rest, (rest - self.rest) / sim.step, sim.law.stiffness
        )
        self.rest = rest
        tension = self._tension(cables)
        self.seen.append(skeleton.points(data, bent + self.offset))
        if log:
            self._record(time, cables, tension, skeleton.points(data, bent))
        data.xfrc_applied[:] = 0.0
        force = skeleton.pull(data, ends, along, tension)
        self._push(time)
        if self.bends:
            loads = skeleton.point_loads(data, force)
            flexes = zip(self.effects.flex, self.bends, strict=True)
            self.bends = [flex.bend(loads, bend, sim.step) for flex, bend in flexes]
        self.motors.advance(time, cables.tension)
        mujoco.mj_step2(self.model, data)

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

    def _record(self, time: float, cables: CableMotion, tension: Floats, points: Floats) -> None:
        if (
            not np.isfinite(points).all()
            or self.data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number
        ):
            raise ModelError(f"{self.sim.robot.name} diverged before {time:.3f} s.")
        spring = 0.5 * (cables.tension * np.maximum(cables.extension, 0.0)).sum()
        energy = np.asarray(self.data.energy.sum() + spring)
        self.log.append((points, self.motors.position.copy(), cables.rest, tension, energy))

    def motion(self, before: int, every: int) -> HiddenMotion:
        """What was logged; positions are seen late, by straight lines between the steps."""
        seen = np.array(self.seen)
        late = sum(effect.latency for effect in self.effects.sensing) / self.sim.step
        wanted = np.maximum(before + every * np.arange(len(self.log)) - late, 0.0)
        low = np.minimum(np.floor(wanted).astype(int), len(seen) - 1)
        share = (wanted - low)[:, None, None]
        high = np.minimum(low + 1, len(seen) - 1)
        late_seen = (1 - share) * seen[low] + share * seen[high]
        points, motor, rest, tension, energy = (
            np.array(entry) for entry in zip(*self.log, strict=True)
        )
        return HiddenMotion(points, late_seen, motor, rest, tension, energy)
