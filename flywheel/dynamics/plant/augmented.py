"""A plant with effects: every simulation of a batch can have its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from mujoco.rollout import Rollout as MujocoRollout

from flywheel.dynamics.plant.channels import ChannelKey, Channels
from flywheel.dynamics.plant.laws import Geometry, Laws, Memories, grouped, has_laws
from flywheel.dynamics.plant.parameters import PlantParameters, scaled
from flywheel.dynamics.plant.plant import DISABLED, Plant
from flywheel.dynamics.plant.world import scene, strip_visuals
from flywheel.effects import (
    CommandEffect,
    ModelEffect,
    Scales,
    TensionEffect,
    Term,
    Terms,
    points_late,
)
from flywheel.errors import ModelError
from flywheel.records import Floats, State
from flywheel.robots import Robot, add_plain
from flywheel.robots.mujoco_warnings import collected_warnings
from flywheel.smoothing import interpolated

# Simulations per thread that are stepped together: more do not fit into a core's cache.
TOGETHER = 48
WORTH_A_THREAD = 3  # fewest simulations per thread: with fewer, threads wait for each other
FEW = 6  # simulations whose batch is of their size
EDITED = 256  # compiled models with effects kept in the cache
CURRENT = int(mujoco.mjtStage.mjSTAGE_VEL)
# Warnings after which MuJoCo begins again from nothing, and where the number of each stands.
DIVERGED = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{q}")) for q in ("QPOS", "QVEL", "QACC")]
COUNT = 1
NEVER_DISABLED = 31  # an MJCF can disable groups of actuators, up to 30


@dataclass(frozen=True)
class Motion:
    """Motions of a batch of simulations.

    Attributes:
      points: (n, T + 1, P, 3) visible positions of the tracked points [m].
      states: (n, T + 1) full states.
      finite: (n,) bool; a diverged simulation repeats its start.
      memory: effect name -> (n, C) final memory of the cables.
      channels: (n, T + 1, channels) measured beside the points [m or N].
    """

    points: Floats
    states: State
    finite: np.ndarray
    memory: Memories
    channels: Floats

    def __getitem__(self, rows: np.ndarray) -> Motion:
        """A selection or permutation of the simulations."""
        memory = {name: held[rows] for name, held in self.memory.items()}
        points, channels = self.points[rows], self.channels[rows]
        return Motion(points, self.states[rows], self.finite[rows], memory, channels)

    @classmethod
    def joined(cls, pieces: Sequence[Motion], rows: Sequence[np.ndarray]) -> Motion:
        """Join parts, each of which contains the given rows of the whole."""
        whole = cls(
            np.concatenate([p.points for p in pieces]),
            State.joined([p.states for p in pieces]),
            np.concatenate([p.finite for p in pieces]),
            {name: np.concatenate([p.memory[name] for p in pieces]) for name in pieces[0].memory},
            np.concatenate([p.channels for p in pieces]),
        )
        return whole[np.argsort(np.concatenate(rows))]


class AugmentedPlant:
    """The robot's MJCF with effects, stepped in batches.

    Without terms it equals `Plant`, bit by bit.

    Args:
      plant: the plant without effects; one set of parameters.
      channels: kinds and names of what is measured beside the points.
    """

    def __init__(self, plant: Plant, channels: Sequence[ChannelKey] = ()) -> None:
        self.plant, self.robot, self.dt = plant, plant.robot, plant.dt
        self.threads = max(1, plant.threads)
        self._scales = Scales.of(plant.robot)
        both = (_with_pulls(plant, movable, channels) for movable in (False, True))
        (self._model, self._channels), (self._movable, _) = both
        self._cables = Geometry.of(self._model, plant.robot, _parameters(plant))
        self._engine = MujocoRollout(nthread=self.threads if self.threads > 1 else 0)
        self._data = {
            id(model): [mujoco.MjData(model) for _ in range(self.threads)]
            for model in (self._model, self._movable)
        }
        self._edited: dict[tuple[object, ...], mujoco.MjModel] = {}
        self._batches: dict[tuple[bool, int], Batch] = {}  # movable, size

    def commands(self, controls: Floats, terms: Sequence[Terms]) -> Floats:
        """The commands (n, T, W) that reach the winches, given all commands of an episode.

        Of points that are measured later than channels, those of some more steps follow.

        Args:
          controls: (n, T, W) commands.
          terms: of each simulation.
        """
        told = np.clip(controls, self.robot.control_low, self.robot.control_high)
        further = int(np.ceil(self._late(terms).max(initial=0.0)))
        told = np.concatenate([told, np.repeat(told[:, -1:], further, axis=1)], axis=1)
        width = len(self.robot.winches)
        groups = grouped(terms, CommandEffect, width)  # type: ignore[type-abstract]
        for effect, rows, values in sorted(groups, key=lambda group: group[0].stage):
            told[rows] = effect.command(told[rows], values, self.robot, self.dt)
        return told

    def _late(self, terms: Sequence[Terms]) -> Floats:
        """(n,) control steps by which points are measured later than channels; 0 without channels."""
        late = [points_late(each) if self._channels.keys else 0.0 for each in terms]
        return np.round(np.array(late) / self.dt, 9)  # 0.07 / 0.01 is a little more than seven

    def simulate(
        self,
        start: State,
        told: Floats,
        terms: Sequence[Terms],
        memory: Memories | None = None,
        steps: int | None = None,
    ) -> Motion:
        """Simulate each state under the commands that reach the winches.

        Args:
          start: (n,) states.
          told: (n, T, W) see `commands`; not clipped again.
          terms: of each simulation.
          memory: effect name -> (n, C), from an earlier piece; none for fresh cables.
          steps: T of the motion; later commands are for channels only. None for all of them.

        Raises:
          ModelError: shapes do not fit.
        """
        total, steps = len(told), told.shape[1] if steps is None else steps
        if len(start.qpos) != total or len(terms) != total:
            raise ModelError(
                f"{total} simulations need as many starts and terms, got {len(start.qpos)} and "
                f"{len(terms)}."
            )
        memory = dict(memory or {})
        groups = grouped(terms, TensionEffect, len(self.robot.cables))  # type: ignore[type-abstract]
        for law, _, _ in groups:
            if law.remembers and law.name not in memory:
                memory[law.name] = np.zeros((total, len(self.robot.cables)))
        moves = np.array([any(_moves_mass(term) for term in each) for each in terms])
        pieces, order = [], []
        with collected_warnings():
            for base, members in ((self._model, ~moves), (self._movable, moves)):
                for rows in _pieces(np.flatnonzero(members), TOGETHER * self.threads):
                    part = {name: held[rows] for name, held in memory.items()}
                    here = [terms[row] for row in rows]
                    pieces.append(self._simulate(base, start[rows], told[rows], here, part, steps))
                    order.append(rows)
        return Motion.joined(pieces, order)

    def _simulate(
        self,
        base: mujoco.MjModel,
        start: State,
        told: Floats,
        terms: Sequence[Terms],
        memory: Memories,
        until: int,
    ) -> Motion:
        if not has_laws(terms):
            return self._rolled_out(base, start, told, terms, memory, until)
        plant, steps, forces = self.plant, told.shape[1], self._channels.forces
        batch = self._batch(base, terms)
        nq, nv = start.qpos.shape[1], start.qvel.shape[1]
        # Indices would be checked one by one, in every step.
        first = np.arange(batch.nsim) < len(terms)
        fields = [batch.bind(name)[: len(terms)] for name in ("qpos", "qvel", "act")]
        for field, values in zip(fields, start.arrays, strict=True):
            field[:] = values
        laws = Laws(self.robot, self._cables, batch, terms, memory, self._scales.slow)
        sensors, ctrl = (batch.bind(name)[: len(terms)] for name in ("sensordata", "ctrl"))
        driven = plant._drive.shape[1]
        ctrl[:] = 0.0
        states = np.empty((len(terms), steps + 1, nq + nv + start.act.shape[1]))
        seen = np.empty((len(terms), steps + 1, sensors.shape[1]))
        batch.forward(first, stage=CURRENT)
        commands = plant.commands(told)
        for step in range(steps + 1):
            states[:, step] = np.concatenate(fields, axis=1)
            seen[:, step] = sensors
            if step == until:
                memory = {name: held.copy() for name, held in laws.memory.items()}
            if step == steps and not forces:
                break
            now = min(step, steps - 1)
            ctrl[:, :driven] = commands[:, now]
            for substep in range(plant.substeps if step < steps else 1):
                cables = laws.cables()
                if laws.on_rates:
                    ctrl[:, :driven] = plant.commands(laws.told(told[:, now], cables))
                if laws.on_tensions:
                    ctrl[:, driven:] = -laws.tension(cables)
                batch.step(first, stage=CURRENT)
                if substep == 0:
                    seen[:, step, forces] = sensors[:, forces]
        alive = ~batch.warning[: len(terms), DIVERGED, COUNT].any(axis=1)
        return self._motion(base, states, seen, alive, terms, memory, until)

    def _rolled_out(
        self,
        base: mujoco.MjModel,
        start: State,
        told: Floats,
        terms: Sequence[Terms],
        memory: Memories,
        until: int,
    ) -> Motion:
        """All steps in one call into MuJoCo: no law acts between them."""
        plant, steps = self.plant, told.shape[1]
        commands = np.zeros((len(told), plant.substeps * steps + 1, base.nu))
        driven = np.repeat(plant.commands(told), plant.substeps, axis=1)
        commands[:, :-1, : driven.shape[2]] = driven
        models = [self._compiled(base, each) for each in terms]
        data, begun = self._data[id(base)], plant.packed(start)
        after, before = self._engine.rollout(models, data, begun, commands)
        full = after[:, plant.substeps - 1 : -1 : plant.substeps]
        expected = self.dt * np.arange(1, steps + 1)
        alive = (np.abs(full[..., 0] - expected) < self.robot.timestep / 2).all(axis=1)
        states = np.concatenate([begun[:, None], full], axis=1)[..., 1:]
        return self._motion(base, states, before[:, :: plant.substeps], alive, terms, memory, until)

    def _motion(
        self,
        base: mujoco.MjModel,
        states: Floats,
        seen: Floats,
        alive: np.ndarray,
        terms: Sequence[Terms],
        memory: Memories,
        until: int,
    ) -> Motion:
        """The motion until a step, of states (n, T + 1, nq + nv + na) and sensor data (n, T + 1, S)."""
        for row in np.flatnonzero(~alive):  # their later states are meaningless
            states[row, 1:], seen[row, 1:] = states[row, 0], seen[row, 0]
        keyframe = self.robot.keyframe
        nq, nv = len(keyframe.qpos), len(keyframe.qvel)
        state = State(*np.split(states, [nq, nq + nv], axis=-1))
        models = [self._compiled(base, each) for each in terms] if self._channels.keys else []
        channels = self._channels.read(seen, self.plant.winch(state), models)
        at = np.arange(until + 1) + self._late(terms)[:, None]
        seen, state = seen[:, : until + 1], state[:, : until + 1]
        points = seen[..., self.plant._points]
        return Motion(points, state, alive, memory, interpolated(channels, at))

    def _batch(self, base: mujoco.MjModel, terms: Sequence[Terms]) -> Batch:
        """A batch whose first simulations run on the models required by the terms.

        Unless there are few it is larger than necessary: one for each size would take gigabytes.
        """
        count = len(terms)
        size = count
        if count > FEW:
            size = TOGETHER * (self.threads if count > TOGETHER else 1)
        key = (base is self._movable, size)
        if key not in self._batches:
            threads = max(1, min(self.threads, size // WORTH_A_THREAD))
            self._batches[key] = Batch(base, size, threads, persistent=True)
        batch = self._batches[key]
        models = [self._compiled(base, each) for each in terms]
        batch.set_models(models + [base] * (batch.nsim - len(models)))
        batch.reset(np.arange(len(models)), stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        return batch

    def _compiled(self, base: mujoco.MjModel, terms: Terms) -> mujoco.MjModel:
        """The model with the terms that MuJoCo can express."""
        native = tuple(t for t in terms if isinstance(t.effect, ModelEffect) and not t.absent)
        key = tuple((t.effect.name, t.place, t.values) for t in native)
        if not native:
            return base
        if key not in self._edited:
            if len(self._edited) > EDITED:
                self._edited.clear()
            self._edited[key] = edited(base, self.robot, native, self._data[id(base)][0])
        return self._edited[key]


def _moves_mass(term: Term) -> bool:
    return isinstance(term.effect, ModelEffect) and term.effect.moves_mass and not term.absent


def edited(
    model: mujoco.MjModel, robot: Robot, terms: Terms, data: mujoco.MjData | None = None
) -> mujoco.MjModel:
    """A copy of the model with terms compiled into it; the model itself without any.

    Args:
      data: of the model, to be overwritten; None for new data.
    """
    if not terms:
        return model
    model = model.__copy__()
    for term in terms:
        assert isinstance(term.effect, ModelEffect)
        term.effect.edit(model, robot, term.place, term.named)
    mujoco.mj_setConst(model, data or mujoco.MjData(model))
    return model


def _with_pulls(
    plant: Plant, movable: bool, channels: Sequence[ChannelKey]
) -> tuple[mujoco.MjModel, Channels]:
    """The plant's model with one more actuator per cable, whose control is a tension [N], and channels.

    Args:
      plant: the plant.
      movable: without MuJoCo's optimisation for bodies whose centre of mass never moves.
      channels: kinds and names of what is measured beside the points.
    """
    spec = scene(plant.robot, plant.terrain)
    strip_visuals(spec)
    for tendon in list(spec.tendons):
        add_plain(
            spec,
            "actuator",
            target=tendon.name,
            trntype=mujoco.mjtTrn.mjTRN_TENDON,
            group=NEVER_DISABLED,
        )
    if movable:
        for body in spec.bodies[1:]:
            body.simple = False
    sensors = Channels(spec, plant.robot, channels)
    model = spec.compile()
    model.opt.disableflags |= DISABLED
    sensors.compiled(model)
    return scaled(model, plant.robot, _parameters(plant)), sensors


def _parameters(plant: Plant) -> PlantParameters:
    """The one parameter set that a plant with effects has."""
    parameters = plant.parameters
    return parameters[0] if isinstance(parameters, Sequence) else parameters


def _pieces(rows: np.ndarray, most: int) -> list[np.ndarray]:
    """Rows in pieces of similar length, at most `most`."""
    return np.array_split(rows, -(-len(rows) // most)) if len(rows) else []
