"""From commands to rest lengths: delay, lag, gain, motor, gear play, spool."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.effect import RestEffect, WinchEffect


class Motors:
    """The winches of one simulation, stepped together.

    Args:
      robot: of the winches.
      start: (W,) positions they hold before the first command [m].
      dt: duration of each command [s].
      step: time step [s].
      effects: on winches, in the order in which they act.
      slips: on rest lengths.
    """

    def __init__(
        self,
        robot: Robot,
        start: Floats,
        dt: float,
        step: float,
        effects: Sequence[WinchEffect] = (),
        slips: Sequence[RestEffect] = (),
    ) -> None:
        self._robot, self._dt, self._step = robot, dt, step
        self._effects, self._slips = tuple(effects), tuple(slips)
        self._hold = robot.holding(start)
        self.position = start.copy()
        self._followed = [self._hold.copy() for _ in effects]
        self._spooled = [start.copy() for _ in effects]
        self._delay = sum(effect.delay for effect in effects)
        self._heard = 0  # commands so far
        self._commands: deque[Floats] = deque(maxlen=int(np.ceil(self._delay / dt)) + 2)
        gain = float(np.prod([effect.gain for effect in effects]))
        lag = np.array([winch.time_constant for winch in robot.winches])
        self._gain = gain
        with np.errstate(divide="ignore"):
            self._approach = np.where(robot.rate_driven, 0.0, -np.expm1(-step * gain / lag))
        self._winch = np.array([cable.winch for cable in robot.cables])
        self._driven = self._winch >= 0
        self._length = np.array([cable.rest_length for cable in robot.cables])
        self._at_keyframe = robot.winch_of(robot.keyframe)

    def hear(self, command: Floats) -> None:
        """The next command (W,): the first for time 0 to dt, and so on; the last one stays."""
        robot = self._robot
        self._commands.append(np.clip(command, robot.control_low, robot.control_high))
        self._heard += 1

    def command(self, time: float) -> Floats:
        """Mean command (W,) that arrives over the step that begins at `time`."""
        begin = time - self._delay
        index = int(np.floor(begin / self._dt + 1e-9))
        share = np.clip(((index + 1) * self._dt - begin) / self._step, 0.0, 1.0)
        now, following = self._sent(index), self._sent(index + 1)
        return now if share > 1 - 1e-6 else share * now + (1 - share) * following

    def _sent(self, index: int) -> Floats:
        if index < 0 or not self._heard:
            return self._hold
        return self._commands[-1 - max(0, self._heard - 1 - index)]

    def rest(self, time: float) -> Floats:
        """(C,) rest lengths now [m]."""
        paid_out = self.position
        for spooled in self._spooled:  # each starts from the one before
            paid_out = spooled
        moved = paid_out - self._at_keyframe
        rest = np.where(self._driven, self._length + moved[self._winch], self._length)
        for slip in self._slips:
            rest = rest + slip.added(time, len(rest))
        return rest

    def advance(self, time: float, tension: Floats) -> None:
        """One step under the elastic tensions (C,) of the cables."""
        load = np.zeros(len(self._robot.winches))
        np.maximum.at(load, self._winch[self._driven], tension[self._driven])
        command = self.command(time)
        for i, effect in enumerate(self._effects):
            command, self._followed[i] = effect.follow(command, self._followed[i], self._step)
        rate = np.where(
            self._robot.rate_driven,
            self._gain * command,
            self._approach * (command - self.position) / self._step,
        )
        for effect in self._effects:
            rate = effect.limit(rate, load, self.position)
        moved = self.position + rate * self._step
        self.position = np.clip(moved, self._robot.rest_low, self._robot.rest_high)
        paid_out = self.position
        for i, effect in enumerate(self._effects):
            paid_out = self._spooled[i] = effect.spool(paid_out, self._spooled[i])
