"""Simulate all windows with a plant and effects, from given initial states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.fitting.initial_states import nominal_winch
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.dynamics.plant import AugmentedPlant, Motion, Plant, hasty, moved, refined, turning
from flywheel.effects import Scales, TensionEffect, Terms, WinchEffect
from flywheel.records import Floats, State

Memories = dict[str, Floats]
HASTY = 0  # in the place of a fineness: `hasty` steps


@dataclass(frozen=True)
class InitialStates:
    """Initial states of windows and recordings, which belong to them and not to the robot.

    Attributes:
      mechanics: (K,) states at the start of each window; their activations are ignored.
      winch: (recordings, W) deviations of the winches from their nominal positions at the start of
        each recording [m].
    """

    mechanics: State
    winch: Floats


@dataclass(frozen=True)
class Carried:
    """State passed from window to window, under one set of terms.

    Attributes:
      winch: (K, W) winch positions at the windows' starts [m].
      memory: effect name -> (K, C).
    """

    winch: Floats
    memory: Memories


class WindowSimulator:
    """Simulates windows with one plant, each in its own time steps.

    Args:
      windows: to be predicted.
      plant: without effects.
      busy: called before every simulation.

    Attributes:
      winch_unit: natural unit of winch positions: the robot's length [m], or its weight [N].
      fineness: (K,) ratio of the plant's MuJoCo step to each window's; see `halved` and `HASTY`.
    """

    def __init__(
        self, windows: Windows, plant: Plant, busy: Callable[[], None] = lambda: None
    ) -> None:
        self.windows, self.plant, self._busy = windows, plant, busy
        self.fineness = np.ones(len(windows), int)
        self._channels = [channel.key for channel in windows.channels]
        self.augmented = AugmentedPlant(plant, self._channels)
        self._engines = {1: self.augmented}  # by fineness, in common with all finer ones
        self.nominal = nominal_winch(windows)[:, 0]
        scales = Scales.of(windows.robot)
        angles = turning(plant)
        # one unit of each entry of a change of start: positions, then velocities
        length, time = scales.length, scales.time
        self.unit = np.concatenate(
            [np.where(angles, 1.0, length), np.where(angles, 1.0, length) / time]
        )
        self.winch_unit = scales.weight if windows.robot.tension_driven else length

    def halved(self, where: np.ndarray | bool = True) -> WindowSimulator:
        """The same with steps of half the length in windows `where` (K,), by default in all."""
        halved = copy(self)
        halved.fineness = np.where(where, 2 * self.fineness, self.fineness)
        return halved

    def hasty(self, where: np.ndarray | bool = True) -> WindowSimulator:
        """The same with `hasty` steps in windows `where` (K,)."""
        rough = copy(self)
        rough.fineness = np.where(where, HASTY, self.fineness)
        return rough

    @property
    def tangent(self) -> int:
        """Length of a change of one window's start."""
        return len(self.unit)

    def told(self, terms: Sequence[Terms]) -> list[Floats]:
        """Per log, the commands (n, T, W) that reach the winches under each of n sets of terms."""
        return [
            self.augmented.commands(np.repeat(log.controls[None], len(terms), axis=0), terms)
            for log in self.windows.recordings
        ]

    def _of(self, told: Sequence[Floats], window: int) -> Floats:
        """(n, steps and more, W) commands of a window, of those `told` to the winches in each log."""
        log, first = self.windows.recording[window], self.windows.first[window]
        further = told[log].shape[1] - len(self.windows.recordings[log].controls)
        return told[log][:, first : first + self.windows.steps + further]

    def chained(
        self, starts: InitialStates, terms: Sequence[Terms]
    ) -> tuple[Floats, list[Carried]]:
        """Predict all windows of a log, under each of n sets of terms.

        Winch positions and memories of cables continue from window to window.

        Returns:
          (n, K, steps + 1, P, 3) points [m], NaN if the simulation diverged; and the start of each
          window.
        """
        ways = (self._beside_each_other, self._one_after_the_other)
        apart = np.array([self.apart(each) for each in terms], bool)
        points = np.empty((len(terms), *self.windows.measured.shape))
        carried: dict[int, Carried] = {}
        for predict, members in zip(ways, (apart, ~apart), strict=True):
            if members.any():
                rows = np.flatnonzero(members)
                points[rows], began = predict(starts, [terms[int(i)] for i in rows])
                carried |= dict(zip(rows.tolist(), began, strict=True))
        return points, [carried[i] for i in range(len(terms))]

    def apart(self, terms: Terms) -> bool:
        """True if the starts of windows are known without simulating previous ones."""
        return bool(self.windows.robot.rate_driven.all()) and not any(
            isinstance(term.effect, WinchEffect)
            or (isinstance(term.effect, TensionEffect) and term.effect.remembers)
            for term in terms
        )

    def _beside_each_other(
        self, starts: InitialStates, terms: Sequence[Terms]
    ) -> tuple[Floats, list[Carried]]:
        """All windows of `chained` at once, because steps of large batches cost less."""
        self._busy()
        windows, count, told = self.windows, len(terms), self.told(terms)
        winch = self._winches(starts.winch, told)
        commands = np.stack([self._of(told, k) for k in range(len(windows))], axis=1)
        total = count * len(windows)
        begun = winch.reshape(total, winch.shape[-1])
        state = self.with_winch(State.joined([starts.mechanics] * count), begun)
        each = [t for t in terms for _ in range(len(windows))]
        members = np.tile(np.arange(len(windows)), count)
        motion = self._simulated(members, state, commands.reshape(total, *commands.shape[2:]), each)
        points = self._seen(motion).reshape(count, *windows.measured.shape)
        return points, [Carried(winch[i], {}) for i in range(count)]

    def began(self, winch: Floats, terms: Terms) -> Carried:
        """Starts of windows under terms that leave them `apart`, with offsets (recordings, W) [m]."""
        return Carried(self._winches(winch, self.told([terms]))[0], {})

    def _winches(self, offsets: Floats, told: Sequence[Floats]) -> Floats:
        """(n, K, W) winch positions at window starts, given each log's commands (n, T, W), with
        offsets (recordings, W).
        """
        windows = self.windows
        begins = self.nominal[windows.first == 0] + offsets
        wound = [self._wound(*each) for each in zip(begins, told, strict=True)]
        at = zip(windows.recording, windows.first, strict=True)
        return np.stack([wound[log][:, first] for log, first in at], axis=1)

    def _wound(self, start: Floats, told: Floats) -> Floats:
        """(n, T + 1, W) positions of rate winches that start at (W,) and receive (n, T, W)."""
        plant, robot = self.plant, self.windows.robot
        within = np.clip(start, robot.rest_low, robot.rest_high)
        begin = np.repeat(within[None], len(told), axis=0)
        return robot.wind(begin, told * plant.winch_speed, plant.dt)

    def _one_after_the_other(
        self, starts: InitialStates, terms: Sequence[Terms]
    ) -> tuple[Floats, list[Carried]]:
        """The windows of `chained`, the first of each recording before the second, and so on."""
        windows, count = self.windows, len(terms)
        told = self.told(terms)
        points = np.empty((count, *windows.measured.shape))
        winch = np.empty((count, len(windows), len(windows.robot.winches)))
        memory: Memories = {}
        kept: list[tuple[np.ndarray, Memories]] = []
        held = np.repeat((self.nominal[windows.first == 0] + starts.winch)[None], count, axis=0)
        for members in windows.ranks:
            self._busy()
            logs = windows.recording[members]
            state = State.joined([starts.mechanics[members]] * count)
            now = held[:, logs]
            winch[:, members] = now
            state = self.with_winch(state, now.reshape(len(state.qpos), now.shape[-1]))
            each = [t for t in terms for _ in members]
            pieces = [self._of(told, k) for k in members]
            commands = np.stack(pieces, axis=1).reshape(len(each), *pieces[0].shape[1:])
            carried = _of_recordings(memory, count, logs)
            motion = self._simulated(np.tile(members, count), state, commands, each, carried)
            kept.append((members, _started_with(carried, motion.memory)))
            seen = self._seen(motion)
            points[:, members] = seen.reshape(count, len(members), *seen.shape[1:])
            last = self.plant.winch(motion.states[:, -1]).reshape(now.shape)
            held[:, logs] = last
            memory = _to_recordings(motion.memory, count, logs, len(windows.recordings))
        return points, [self._carried(winch[i], kept, i, count) for i in range(count)]

    def parallel(
        self,
        starts: State,
        carried: Carried,
        terms: Terms,
        members: np.ndarray,
        winch: Floats | None = None,
    ) -> Floats:
        """Predict windows independently, each from its own start.

        Args:
          starts: (n,) states; activations are ignored.
          carried: under these terms.
          terms: of all simulations.
          members: (n,) window of each.
          winch: (n, W) winch positions at the starts [m]; None for those carried over.

        Returns:
          (n, steps + 1, P, 3) points [m]; NaN if the simulation diverged.
        """
        self._busy()
        windows = self.windows
        if not len(members):
            return np.empty((0, *windows.measured.shape[1:]))
        told = self.told([terms])
        commands = np.stack([self._of(told, k)[0] for k in members])
        memory = {name: values[members] for name, values in carried.memory.items()}
        state = self.with_winch(starts, carried.winch[members] if winch is None else winch)
        motion = self._simulated(members, state, commands, [terms] * len(members), memory)
        return self._seen(motion)

    def _seen(self, motion: Motion) -> Floats:
        """(n, steps + 1, P + C, 3) measurements of a motion, as in `Windows.measured`; NaN if it diverged."""
        seen = self.windows.widened(motion.points, motion.channels)
        return np.where(motion.finite[:, None, None, None], seen, np.nan)

    def _simulated(
        self,
        members: np.ndarray,
        state: State,
        told: Floats,
        terms: Sequence[Terms],
        memory: Memories | None = None,
    ) -> Motion:
        """Simulate windows `members` (n,), each in sufficiently short steps."""
        fineness = self.fineness[members]
        pieces, order = [], []
        for times in np.unique(fineness).tolist():
            if times not in self._engines:
                plant = hasty(self.plant) if times == HASTY else refined(self.plant, times)
                self._engines[times] = AugmentedPlant(plant, self._channels)
            rows = np.flatnonzero(fineness == times)
            part = {name: held[rows] for name, held in (memory or {}).items()}
            here = [terms[int(row)] for row in rows]
            engine, steps = self._engines[times], self.windows.steps
            pieces.append(engine.simulate(state[rows], told[rows], here, part, steps))
            order.append(rows)
        return Motion.joined(pieces, order)

    def with_winch(self, state: State, winch: Floats) -> State:
        """The states with winches at (n, W) [m], within their ranges."""
        robot = self.windows.robot
        within = np.clip(winch, robot.rest_low, robot.rest_high)
        return State(state.qpos, state.qvel, self.plant.activation(within))

    def moved(self, state: State, change: Floats) -> State:
        """States (n,) changed by (n, tangent), in units of `unit`."""
        position, velocity = np.split(change * self.unit, 2, axis=1)
        return moved(self.plant, state, position, velocity)

    def _carried(
        self, winch: Floats, kept: list[tuple[np.ndarray, Memories]], index: int, count: int
    ) -> Carried:
        memory: Memories = {}
        for members, part in kept:
            for name, values in part.items():
                rows = values.reshape(count, len(members), -1)[index]
                whole = memory.setdefault(name, np.zeros((len(self.windows), rows.shape[-1])))
                whole[members] = rows
        return Carried(winch, memory)


def _of_recordings(memory: Memories, count: int, logs: np.ndarray) -> Memories:
    """Memories of these recordings, as rows, from (count, all recordings, C)."""
    return {name: v[:, logs].reshape(count * len(logs), -1) for name, v in memory.items()}


def _to_recordings(memory: Memories, count: int, logs: np.ndarray, total: int) -> Memories:
    """The inverse: rows as (count, all logs, C)."""
    spread: Memories = {}
    for name, values in memory.items():
        rows = values.reshape(count, len(logs), -1)
        spread[name] = np.zeros((count, total, rows.shape[-1]))
        spread[name][:, logs] = rows
    return spread


def _started_with(before: Memories, after: Memories) -> Memories:
    """Starts of simulations; empty if the law was not there yet."""
    return {name: before.get(name, np.zeros_like(values)) for name, values in after.items()}
