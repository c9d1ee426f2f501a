"""The plant: the robot's MJCF simulated in batches by MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.rollout import Rollout as MujocoRollout

from flywheel.dynamics.plant.parameters import PlantParameters, scaled
from flywheel.dynamics.plant.world import scene
from flywheel.effects import Terms
from flywheel.errors import ModelError
from flywheel.records import Floats, Observation, State, Trajectory
from flywheel.robots import Robot
from flywheel.robots.mujoco_warnings import collected_warnings
from flywheel.terrain import Terrain

FULL = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
NOMINAL = PlantParameters()
# Warm starts would make results depend on how the time is split (they save 5 %). Commands are
# clipped here, before anything that makes a winch faster than it was told.
DISABLED = int(mujoco.mjtDisableBit.mjDSBL_WARMSTART | mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
OUTPUT_BYTES = 64 << 20  # steps per call into MuJoCo; longer simulations take several calls


class Plant:
    """The simulated robot, stepped in batches.

    It has no state: `simulate` maps states and controls to trajectories. The result is independent
    of the number of threads, of the split of a batch into calls, and, because the contact solver
    starts cold in every step, of the split in time (bit by bit). It can be pickled.

    Args:
      robot: the robot.
      dt: control step [s], a multiple of the robot's own timestep.
      parameters: one set for all simulations, or one for each of the batch.
      threads: simulations stepped at the same time.
      terrain: replaces the robot's ground plane, with the boxes to collide with.

    Attributes:
      terms: permanent effects; see `EffectivePlant`.

    Raises:
      ModelError: dt is not a multiple of the robot's timestep; a terrain for a robot without a ground.
    """

    terms: Terms = ()

    def __init__(
        self,
        robot: Robot,
        dt: float = 0.01,
        parameters: PlantParameters | Sequence[PlantParameters] = NOMINAL,
        threads: int = 1,
        terrain: Terrain | None = None,
    ) -> None:
        self.robot, self.dt, self.threads = robot, dt, threads
        self.parameters = parameters
        self.terrain = terrain
        if (steps := robot.control_steps(dt)) != (dt,):
            raise ModelError(
                f"dt {dt:g} s must be a multiple of the timestep of {robot.name}, {robot.timestep:g} s: "
                f"{' or '.join(f'{step:.12g}' for step in steps)} s would be."
            )
        self.substeps = round(dt / robot.timestep)
        self._compile()

    def __reduce__(self) -> tuple[Any, ...]:
        return (Plant, (self.robot, *self.arguments()))

    def arguments(self) -> tuple[Any, ...]:
        """Arguments of `Plant` after the robot."""
        return self.dt, self.parameters, self.threads, self.terrain

    def on(self, terrain: Terrain | None) -> Plant:
        """The same plant on another ground; itself if that is its own."""
        if terrain == self.terrain:
            return self
        return Plant(self.robot, *(*self.arguments()[:-1], terrain))

    def _compile(self) -> None:
        robot = self.robot
        base = scene(robot, self.terrain).compile()
        base.opt.disableflags |= DISABLED
        every = self.parameters
        sets = [every] if isinstance(every, PlantParameters) else list(every)
        distinct = {p: scaled(base, robot, p) for p in dict.fromkeys(sets)}
        self._models = [distinct[p] for p in sets]
        self._data = [mujoco.MjData(base) for _ in range(max(1, self.threads))]
        self._engine = MujocoRollout(nthread=self.threads if self.threads > 1 else 0)
        self._state_size = mujoco.mj_stateSize(base, FULL)
        self._sensor_size = base.nsensordata
        if self._state_size != 1 + base.nq + base.nv + base.na:
            raise ModelError(
                f"The MJCF of {robot.name} has state beyond positions, velocities and activations "
                "(delays, plugins or plastic tendons), which a State cannot hold."
            )
        self._points = _sensor_columns(base, [p.name for p in robot.points])
        first = np.array([w.actuators[0] for w in robot.winches], int)
        self._winch_act = base.actuator_actadr[first]
        speed = np.array([p.winch_speed for p in sets])[:, None, None]
        self._speed = np.where(robot.rate_driven, speed, 1.0)  # (1 or B, 1, W)
        self._drive, self._drive_shift = _drive(base, robot)
        self._spool = np.zeros((len(first), base.na))
        for index, winch in enumerate(robot.winches):
            self._spool[index, base.actuator_actadr[list(winch.actuators)]] = winch.ratios

    @property
    def winch_speed(self) -> Floats:
        """(W,) ratio of the rate of each winch of the (first) simulation to its command [-]."""
        return np.asarray(self._speed[0, 0])

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model of the (first) simulation."""
        return self._models[0]

    def rest(self, n: int = 1) -> State:
        """The keyframe, `n` times."""
        key = self.robot.keyframe
        return State(*(np.repeat(a[None], n, axis=0) for a in key.arrays))

    def settle(self, seconds: float, n: int = 1, start: State | None = None) -> State:
        """`n` times the keyframe, or `start`, after `seconds` with holding winches."""
        start = self.rest(n) if start is None else start
        hold = self.robot.holding(start.act[:, self._winch_act])
        controls = np.repeat(hold[:, None], round(seconds / self.dt), axis=1)
        states = self.simulate(start, controls).states
        assert states is not None
        return states[:, -1]

    def winch(self, state: State) -> Floats:
        """Winch positions (..., W) of a state [m]."""
        return state.act[..., self._winch_act]

    def activation(self, winch: Floats) -> Floats:
        """Activations (..., na) of a state with winch positions (..., W) [m]."""
        key = self.robot.keyframe.act
        return key + (winch - key[self._winch_act]) @ self._spool

    def observe(self, state: State) -> Observation:
        """Noise-free observation of states of any leading shape; all winches count as measured."""
        lead = state.qpos.shape[:-1]
        count = math.prod(lead)
        packed = self.packed(State(*(a.reshape(count, a.shape[-1]) for a in state.arrays)))
        _, sensors = self._run(packed, np.zeros((len(packed), 1, self._drive.shape[1])))
        points = sensors[:, 0, self._points]
        return Observation(points.reshape(*lead, *points.shape[1:]), self.winch(state))

    def simulate(self, state: State, controls: Floats) -> Trajectory:
        """Simulate each state under its controls.

        Args:
          state: of batch size B, or 1 to start all from the same state.
          controls: (B, T, W) commands, T >= 1; clipped to the winches' control ranges.

        Returns:
          (B, T) trajectories with full states and noise-free observations.

        Raises:
          ModelError: shapes do not fit, or a simulation diverged; the message says which one and
            when.
        """
        controls = np.asarray(controls, float)
        batch, steps = self._check(state, controls)
        controls = np.clip(controls, self.robot.control_low, self.robot.control_high)
        commands = self.commands(controls)
        states = np.empty((batch, steps + 1, self._state_size))
        points = np.empty((batch, steps + 1, *self._points.shape))
        states[:, 0] = self.packed(state)
        rows = self.substeps * max(1, batch) * (self._state_size + self._sensor_size) * 8
        stride = max(1, OUTPUT_BYTES // rows)
        for start in range(0, steps, stride):
            stop = min(start + stride, steps)
            substeps = np.repeat(commands[:, start:stop], self.substeps, axis=1)
            states[:, start, 0] = 0.0  # each piece has its own clock
            after, before = self._run(states[:, start], substeps)
            self._refuse_divergence(after, start)
            states[:, start + 1 : stop + 1] = after[:, self.substeps - 1 :: self.substeps]
            points[:, start:stop] = before[:, :: self.substeps][..., self._points]
        full = self.unpacked(states)
        points[:, -1] = self.observe(full[:, -1]).points
        seen = Observation(points, self.winch(full))
        return Trajectory(seen, controls, self.dt, full)

    def begin(self, state: State) -> Course:
        """An episode from a state (1,), to be simulated piece by piece."""
        return Course(self, state)

    def commands(self, controls: Floats) -> Floats:
        """Controls (..., nu) of MuJoCo's actuators for winch controls (..., W) within their ranges."""
        return (controls * self._speed) @ self._drive + self._drive_shift

    def packed(self, state: State) -> Floats:
        """MuJoCo's state vectors (B, 1 + nq + nv + na) of states (B,), at time 0."""
        time = np.zeros((len(state.qpos), 1))
        return np.concatenate([time, state.qpos, state.qvel, state.act], axis=1)

    def _check(self, state: State, controls: Floats) -> tuple[int, int]:
        """Batch size and steps of a call, or a ModelError."""
        robot, key = self.robot, self.robot.keyframe
        if controls.ndim != 3 or controls.shape[2] != len(robot.winches) or not controls.shape[1]:
            raise ModelError(
                f"{robot.name} takes controls (B, T, {len(robot.winches)}) with T >= 1, got "
                f"{controls.shape}."
            )
        if not np.isfinite(controls).all():
            raise ModelError("Controls must be finite; got NaN or infinity.")
        batch, steps = controls.shape[:2]
        for name, got, one in zip(("qpos", "qvel", "act"), state.arrays, key.arrays, strict=True):
            if got.ndim != 2 or len(got) not in (1, batch) or got.shape[1] != len(one):
                raise ModelError(
                    f"A state of {robot.name} needs {name} ({batch} or 1, {len(one)}) for controls of "
                    f"batch size {batch}, got {got.shape}."
                )
        if len(self._models) not in (1, batch):
            raise ModelError(
                f"This plant has {len(self._models)} sets of parameters, one per simulation; got "
                f"controls for {batch} simulations."
            )
        return batch, steps

    def _run(self, packed: Floats, commands: Floats) -> tuple[Floats, Floats]:
        """States after, and sensors before, each of the substeps.

        MuJoCo reads its sensors at the beginning of a step, hence "before".
        """
        models = self._models if len(self._models) == len(packed) else self._models[:1]
        with collected_warnings():
            if not commands.shape[2]:  # MuJoCo takes none for wrong ones
                steps = commands.shape[1]
                return self._engine.rollout(models, self._data, packed, nstep=steps)
            states, sensors = self._engine.rollout(models, self._data, packed, commands)
        return states, sensors

    def _refuse_divergence(self, states: Floats, first_step: int) -> None:
        """MuJoCo resets a diverged simulation, and with it the clock: entry 0 of the state."""
        expected = self.robot.timestep * np.arange(1, states.shape[1] + 1)
        off = np.abs(states[..., 0] - expected) > self.robot.timestep / 2
        off |= ~np.isfinite(states).all(axis=-1)
        if off.any():
            simulation = int(np.flatnonzero(off.any(axis=1))[0])
            when = first_step * self.dt + off[simulation].argmax() * self.robot.timestep
            raise ModelError(
                f"Simulation {simulation} of {len(states)} of {self.robot.name} diverged at "
                f"{when:.3f} s: MuJoCo found no finite acceleration. Softer contacts or cables, or a "
                "smaller timestep in the MJCF, help."
            )

    def unpacked(self, packed: Floats) -> State:
        """States (...) of MuJoCo's state vectors (..., 1 + nq + nv + na)."""
        nq, nv = len(self.robot.keyframe.qpos), len(self.robot.keyframe.qvel)
        qpos, qvel, act = np.split(packed[..., 1:], [nq, nq + nv], axis=-1)
        return State(qpos, qvel, act)


class Course:
    """One simulation that continues piece by piece, as in the recording of an episode.

    Args:
      plant: that moves.
      state: (1,) its present state, also as an attribute.
    """

    def __init__(self, plant: Plant, state: State) -> None:
        self._plant, self.state = plant, state

    def go(self, controls: Floats) -> Trajectory:
        """Continue under controls (1, T, W) from the present state.

        Raises:
          ModelError: controls do not fit, or the simulation diverged.
        """
        simulated = self._plant.simulate(self.state, controls)
        assert simulated.states is not None
        self.state = simulated.states[:, -1]
        return simulated


def _sensor_columns(model: mujoco.MjModel, names: list[str]) -> np.ndarray:
    """(P, 3) columns of MuJoCo's sensor data that hold the tracked points."""
    start = np.array([model.sensor(name).adr[0] for name in names])
    return start[:, None] + np.arange(3)


def _drive(model: mujoco.MjModel, robot: Robot) -> tuple[Floats, Floats]:
    """Matrix (W, nu) and shift (nu,) that turn controls into MuJoCo's.

    Actuators without a winch get the value nearest to 0 in their range.
    """
    drive = np.zeros((len(robot.winches), model.nu))
    limited = np.where(
        model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, [-np.inf, np.inf]
    )
    shift = np.clip(0.0, *limited.T)
    act = robot.keyframe.act
    for index, winch in enumerate(robot.winches):
        for actuator, ratio in zip(winch.actuators, winch.ratios, strict=True):
            drive[index, actuator], shift[actuator] = ratio, 0.0
            if winch.kind == "position":  # tensions of one winch are equal
                pair = model.actuator_actadr[[actuator, winch.actuators[0]]]
                shift[actuator] = act[pair[0]] - ratio * act[pair[1]]
    return drive, shift
