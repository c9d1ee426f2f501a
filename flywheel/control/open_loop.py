"""Controllers without feedback: they hold, play a script, or excite the robot at random."""

from __future__ import annotations

import numpy as np

from flywheel.control.protocol import Command
from flywheel.errors import ConfigError
from flywheel.records import Floats, Past
from flywheel.robots import Robot
from flywheel.tasks import Task


class Hold:
    """Keeps the winches where they are: a passive robot."""

    name, model, history = "hold", "", 0

    def __init__(self, robot: Robot, dt: float, seconds: float = 1.0) -> None:
        self.robot = robot
        self._steps = max(1, round(seconds / dt))

    def reset(self, task: Task | None, seed: int) -> None:
        """Nothing: it has no state."""

    def act(self, past: Past) -> Command:
        """Hold for another block of steps."""
        return Command(self.sequence(past.winch[0, -1], self._steps, 0))

    def sequence(self, winch: Floats, steps: int, seed: int) -> Floats:
        """The holding command (steps, W)."""
        return np.repeat(self.robot.holding(winch)[None], steps, axis=0)


class Playback:
    """Plays scripted commands, and then holds.

    Args:
      robot: commanded robot.
      controls: (T, W) commands, one for each control step.
      script: name of the script.

    Raises:
      ConfigError: the commands do not fit this robot.
    """

    model, history = "", 0

    def __init__(self, robot: Robot, controls: Floats, script: str = "") -> None:
        self.robot, self.controls = robot, np.asarray(controls, float)
        self.name = f"playback:{script}" if script else "playback"
        winches = len(robot.winches)
        if self.controls.ndim != 2 or self.controls.shape[1] != winches:
            raise ConfigError(
                f"A script for {robot.name} needs {winches} commands in each step, got an array "
                f"of the shape {self.controls.shape}."
            )
        if not np.isfinite(self.controls).all():
            raise ConfigError(f"A script for {robot.name} has commands that are not finite.")
        self._played = 0

    def reset(self, task: Task | None, seed: int) -> None:
        """Start again with the first command."""
        self._played = 0

    def act(self, past: Past) -> Command:
        """The whole script at once; holding commands after it."""
        rest, self._played = self.controls[self._played :], len(self.controls)
        return Command(rest if len(rest) else self.robot.holding(past.winch[0, -1])[None])


class RandomControls:
    """Random winch commands, to collect data before a model exists.

    Each winch independently alternates between moving at a random rate and moving to a random rest
    length and staying there; it switches after a random time.

    Args:
      robot: commanded robot.
      dt: control step [s].
      seconds: (least, most) time between switches [s].
      drive: probability that a winch moves at a rate; else it moves to a rest length.
      slowest: speeds are drawn between this fraction of the fastest and the fastest.
    """

    name, model, history = "random", "", 0

    def __init__(
        self,
        robot: Robot,
        dt: float,
        seconds: tuple[float, float] = (0.3, 3.0),
        drive: float = 0.4,
        slowest: float = 0.3,
    ) -> None:
        self.robot, self.dt = robot, dt
        self.seconds, self.drive, self.slowest = seconds, drive, slowest
        self._rng = np.random.default_rng(0)

    def reset(self, task: Task | None, seed: int) -> None:
        """Start another random episode."""
        self._rng = np.random.default_rng(seed)

    def act(self, past: Past) -> Command:
        """Random commands for the longest time between switches."""
        steps = max(1, round(self.seconds[1] / self.dt))
        return Command(self.sequence(past.winch[0, -1], steps, int(self._rng.integers(2**63))))

    def sequence(self, winch: Floats, steps: int, seed: int) -> Floats:
        """Commands (steps, W) that start at winch positions (W,) [m]."""
        robot, dt = self.robot, self.dt
        wish, speed = self._whims(steps, np.random.default_rng(seed))
        positions = [np.asarray(winch, float)]
        for step in range(steps):  # each position needs the one before
            change = np.clip(wish[step] - positions[-1], -speed[step] * dt, speed[step] * dt)
            positions.append(np.clip(positions[-1] + change, robot.rest_low, robot.rest_high))
        moved = np.stack(positions)
        commands = np.where(robot.rate_driven, np.diff(moved, axis=0) / dt, moved[1:])
        return np.clip(commands, robot.control_low, robot.control_high)

    def _whims(self, steps: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Target and fastest rate of each winch: (steps, W) [m], [m/s]."""
        robot, (least, most) = self.robot, self.seconds
        winches, number = len(robot.winches), int(np.ceil(steps * self.dt / least)) + 1
        shape = (number, winches)
        ends = np.cumsum(rng.uniform(least, most, shape), axis=0)
        now = (np.arange(steps) * self.dt)[:, None, None] >= ends  # (steps, number, W)
        whim = now.sum(axis=1), np.arange(winches)

        rate = np.where(robot.rate_driven, robot.control_high, robot.rest_high - robot.rest_low)
        speed = rng.uniform(self.slowest, 1.0, shape) * rate
        # Driving at a rate is hurrying towards an end of the range.
        end = np.where(rng.random(shape) < 0.5, robot.rest_low, robot.rest_high)
        target = rng.uniform(robot.rest_low, robot.rest_high, shape)
        wish = np.where(rng.random(shape) < self.drive, end, target)
        return wish[whim], speed[whim]
