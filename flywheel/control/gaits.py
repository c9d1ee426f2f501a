"""Gaits of the three-rod robot: sequences of cable lengths."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flywheel.control.protocol import Command
from flywheel.errors import ConfigError
from flywheel.records import Floats, Past
from flywheel.robots import Robot
from flywheel.tasks.task import Task

REST = (1.0,) * 6


@dataclass(frozen=True)
class Pattern:
    """One cycle of a gait. The numbers are those of the robot's published controller.

    Attributes:
      targets: sequence of relative cable lengths; 0 is `shortest`, 1 is `shortest + range` [-].
      shortest: [m].
      range: [m].
      from_behind: the robot's other end counts as its front, so that it goes the other way.
    """

    targets: tuple[tuple[float, ...], ...]
    shortest: float
    range: float
    from_behind: bool = False


FORWARDS = {
    "roll": Pattern(((1, 1, 0.1, 1, 1, 0.1), (0, 1, 1, 0, 1, 0.1)), 0.9, 1.0),
    "cw": Pattern(((1, 1, 0, 0, 0, 0), (0, 1, 0, 0, 0, 0), (0, 1, 1, 0, 0.8, 0)), 0.8, 1.2),
    "ccw": Pattern(((1, 1, 1, 0, 1, 1), (1, 0, 1, 0, 1, 1), (0, 0, 0, 0, 0, 0)), 1.0, 1.0),
}
BACKWARDS = {f"{name}_back": replace(it, from_behind=True) for name, it in FORWARDS.items()}
PATTERNS = FORWARDS | BACKWARDS

TURNING = ("cw", "ccw")

# The robot looks the same from three sides: caps on the ground -> which target each cable takes.
SIDES: dict[tuple[int, ...], tuple[int, ...]] = {
    (0, 2, 5): (0, 1, 2, 3, 4, 5),
    (0, 3, 5): (0, 1, 2, 3, 4, 5),
    (1, 2, 4): (1, 2, 0, 4, 5, 3),
    (1, 2, 5): (1, 2, 0, 4, 5, 3),
    (0, 3, 4): (2, 0, 1, 5, 3, 4),
    (1, 3, 4): (2, 0, 1, 5, 3, 4),
}

# The robot also looks the same with each cap called like this one; its cables come in reverse order then.
BEHIND = (1, 0, 5, 4, 3, 2)

# The two caps whose distance each winch controls.
PAIRS = ((3, 5), (1, 3), (1, 5), (0, 2), (0, 4), (2, 4))

# PID gains on the relative length (the integral is a sum over steps of 0.01 s), and when a length
# counts as reached.
GAIN, INTEGRAL, DERIVATIVE = 6.0, 0.01, 0.5
TOLERANCE = 0.1
PATIENCE = 10.0  # for one target [s]
DWELL = 0.45  # after a target is reached, to let the robot finish tipping over [s]


class Gait:
    """Walks the three-rod robot by feedback on the distances of its end caps.

    Every target is six cable lengths. A winch stops once its length is reached, or once it can do
    no more: it would pay out a slack cable, or pull beyond its shortest rest length. When all have
    stopped, or patience ends, the next target follows after a short dwell.

    Args:
      robot: prism3, or a robot with the same caps and winches.
      pattern: as in `PATTERNS`.
      dt: control step [s].
      cycles: of the pattern, followed by rest; None to repeat without end.
      variation: largest random deviation of a target's lengths, drawn for every target [-]. Without
        it, two gaits from the same start are the same motion.

    Attributes:
      points: (P, 3) where each cap was last seen [m]; NaN before.

    Raises:
      ConfigError: unknown gait, or another kind of robot.
    """

    model, history = "", 0

    def __init__(
        self,
        robot: Robot,
        pattern: str,
        dt: float = 0.01,
        cycles: int | None = None,
        variation: float = 0.0,
    ) -> None:
        if pattern not in PATTERNS:
            raise ConfigError(f"There is no gait {pattern!r}. Known: {', '.join(PATTERNS)}.")
        refuse_other_robots(robot)
        self.robot, self.dt, self.cycles, self.variation = robot, dt, cycles, variation
        self.name = f"gait:{pattern}"
        self.pattern = PATTERNS[pattern]
        self.reset(None, 0)

    def reset(self, task: Task | None, seed: int) -> None:
        """Start again with the first target."""
        self._index = 0
        self._rng = np.random.default_rng(seed)
        self._side = SIDES[0, 2, 5]
        self.points = np.full((len(self.robot.points), 3), np.nan)
        self._reach: Reach | None = None

    @property
    def finished(self) -> bool:
        """True when all cycles are complete and the robot is back at rest."""
        return self._last < self._index and (self._reach is None or self._reach.finished)

    @property
    def begins_cycle(self) -> bool:
        """True when the next command is the first one of a cycle."""
        waits = self._reach is not None and self._reach.finished
        within = (self._index - 1) % len(self.pattern.targets)
        return waits and within == 0 and self._index != self._last

    def act(self, past: Past) -> Command:
        """The command for one control step; winches hold until every cap was seen once."""
        seen = past.observations.points[0, -1]
        self.points = np.where(np.isfinite(seen), seen, self.points)
        rest = past.winch[0, -1]
        if self.finished or not np.isfinite(self.points).all():
            return Command(self.robot.holding(rest)[None])
        if self._reach is None or self._reach.finished:
            self._reach = self._next()
        first, second = np.transpose(PAIRS)
        lengths = np.linalg.norm(self.points[first] - self.points[second], axis=1)
        return Command(self._reach.command(lengths, rest)[None])

    @property
    def _last(self) -> float:
        """Number of the last target: rest, after all cycles."""
        return np.inf if self.cycles is None else 1 + self.cycles * len(self.pattern.targets)

    def _next(self) -> Reach:
        """The next target: rest, the pattern's cycles for the robot's present side, and rest again."""
        step, in_cycle = self._index, (self._index - 1) % len(self.pattern.targets)
        self._index += 1
        if step == 0 or step == self._last:
            return self._reach_for(np.array(REST))
        if in_cycle == 0:
            self._side = self._side_down() or self._side
        return self._reach_for(np.array(self.pattern.targets[in_cycle])[list(self._side)])

    def _side_down(self) -> tuple[int, ...] | None:
        """As in `SIDES`, with the robot's front at its end; None on any other caps."""
        down, back = np.argsort(self.points[:, 2])[:3], self.pattern.from_behind
        side = SIDES.get(tuple(sorted(BEHIND[i] if back else int(i) for i in down)))
        return side[::-1] if side and back else side

    def _reach_for(self, wanted: Floats) -> Reach:
        off = self._rng.uniform(-self.variation, self.variation, len(wanted))
        return Reach(self.robot, self.pattern, np.clip(wanted + off, 0, 1), self.dt)


def turning(robot: Robot, shape: tuple[int, ...], hold: int, rng: np.random.Generator) -> Floats:
    """Plans (K, S, W) of rest lengths [m] that turn the robot: each a gait that turns, on any of its sides.

    Each of a gait's targets lasts for `hold` knots; plans begin anywhere in the cycle.

    Raises:
      ConfigError: another kind of robot.
    """
    refuse_other_robots(robot)
    sides = np.unique([*SIDES.values()], axis=0)
    plans = np.empty(shape)
    for plan in plans:
        pattern = PATTERNS[TURNING[rng.integers(len(TURNING))]]
        targets = np.array(pattern.targets)[:, sides[rng.integers(len(sides))]]
        number = (np.arange(shape[1]) + rng.integers(hold * len(targets))) // hold
        plan[:] = pattern.shortest + pattern.range * targets[number % len(targets)]
    return plans


class Reach:
    """Brings all cables to one target's lengths.

    Args:
      robot: commanded robot.
      pattern: meaning of the relative lengths.
      wanted: (W,) relative lengths.
      dt: control step [s].
    """

    def __init__(self, robot: Robot, pattern: Pattern, wanted: Floats, dt: float):
        self.robot, self.pattern, self.wanted, self.dt = robot, pattern, wanted, dt
        self._stopped = np.zeros(len(wanted), bool)
        self._sum = np.zeros(len(wanted))
        self._before: Floats | None = None
        self._elapsed = self._dwelt = 0.0

    @property
    def finished(self) -> bool:
        """True once the target is reached and the dwell is over, or patience has ended."""
        return self._dwelt > DWELL or self._elapsed >= PATIENCE

    def command(self, lengths: Floats, rest: Floats) -> Floats:
        """Rates (W,) [m/s] for lengths (W,) between caps and rest lengths (W,) [m]."""
        relative = (lengths - self.pattern.shortest) / self.pattern.range
        error = relative - self.wanted
        self._stopped |= self._nothing_to_do(lengths, rest, relative, error)
        slope = 0.0 if self._before is None else (error - self._before) / self.dt
        self._before = error
        self._sum += error * self.dt / 0.01
        self._elapsed += self.dt
        self._dwelt += self.dt if self._stopped.all() else 0.0
        pull = np.clip(GAIN * error + INTEGRAL * self._sum + DERIVATIVE * slope, -1, 1)
        pays_out_slack = (lengths < rest) & (pull < 0)
        return np.where(self._stopped | pays_out_slack, 0.0, -pull * self.robot.control_high)

    def _nothing_to_do(
        self, lengths: Floats, rest: Floats, relative: Floats, error: Floats
    ) -> np.ndarray:
        off = np.abs(error) * np.minimum(self.pattern.range, 1.0)
        beyond = (self.wanted == 0) & (relative < 0)
        slack = (lengths < rest) & (error < 0)
        at_the_end = (rest <= self.robot.rest_low + 1e-6) & (error > 0)
        return (off < TOLERANCE) | beyond | slack | at_the_end


def refuse_other_robots(robot: Robot) -> None:
    """Check that a robot has prism3's caps and winches.

    Raises:
      ConfigError: it does not.
    """
    ends = [
        tuple(sorted(end.point for end in robot.cables[winch.cables[0]].ends))
        for winch in robot.winches
    ]
    if ends != list(PAIRS) or not robot.rate_driven.all():
        raise ConfigError(
            f"The gaits are for prism3's six rate winches between its end caps; {robot.name} has others."
        )
