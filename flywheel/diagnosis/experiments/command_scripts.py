"""Command scripts for experiments: random families, and variations of a script.

A script is drawn as a desired path of each winch; `WinchRange.commands` turns it into feasible
commands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot

HAUL_IN, PAY_OUT = 0.35, 0.12  # how far scripts go from the start, as shares of its rest lengths
PLAIN = "random_steps"  # the family that a design is compared with


@dataclass(frozen=True)
class WinchRange:
    """Range of the winches of a robot in scripts.

    Attributes:
      robot: of the winches.
      start: (W,) positions at which scripts begin [m].
      low, high: (W,) positions between which they stay [m].
      step: (W,) longest motion in one control step [m].
      dt: control step [s].
    """

    robot: Robot
    start: Floats
    low: Floats
    high: Floats
    step: Floats
    dt: float

    @classmethod
    def around(cls, robot: Robot, start: Floats, dt: float) -> WinchRange:
        """Around winch positions (W,) [m], within the robot's ranges.

        Raises:
          RobotError: the robot has no winch.
        """
        robot.require_winches("moved by commands")
        low = np.maximum(robot.rest_low, start * (1 - HAUL_IN))
        high = np.minimum(robot.rest_high, start * (1 + PAY_OUT))
        # a position winch may cross its reach in a second
        rate = np.where(
            robot.rate_driven, np.minimum(robot.control_high, -robot.control_low), high - low
        )
        return cls(robot, start, low, high, np.maximum(rate, 0.0) * dt, dt)

    def path(self, wish: Floats) -> Floats:
        """The path (..., T, W) of winches that follow a desired path (..., T, W) [m]."""
        wish = np.clip(wish, self.low, self.high)
        path, now = np.empty_like(wish), np.broadcast_to(self.start, wish[..., 0, :].shape)
        for t in range(wish.shape[-2]):
            now = now + np.clip(wish[..., t, :] - now, -self.step, self.step)
            path[..., t, :] = now
        return path

    def commands(self, path: Floats) -> Floats:
        """Commands (..., T, W) along a path (..., T, W) [m]."""
        first = np.broadcast_to(self.start, (*path.shape[:-2], 1, path.shape[-1]))
        rates = np.diff(np.concatenate([first, path], axis=-2), axis=-2) / self.dt
        commands = np.where(self.robot.rate_driven, rates, path)
        return np.clip(commands, self.robot.control_low, self.robot.control_high)


Family = Callable[[WinchRange, int, np.random.Generator], Floats]


def random_steps(reach: WinchRange, steps: int, rng: np.random.Generator) -> Floats:
    """Every winch moves at a random rate, which changes every 0.3 to 0.8 s; sometimes it rests."""
    shape = (1 + int(steps * reach.dt / 0.3), len(reach.start))
    ends = np.cumsum(rng.uniform(0.3, 0.8, shape), axis=0)
    rate = rng.uniform(-0.8, 0.8, shape) * (rng.random(shape) > 0.25)
    piece = (reach.dt * np.arange(steps)[:, None, None] >= ends).sum(axis=1)
    moves = np.take_along_axis(rate, np.minimum(piece, len(rate) - 1), axis=0) * reach.step
    path, now = np.empty(moves.shape), reach.start
    for t in range(steps):  # at an end of the reach a winch waits for the next rate
        now = path[t] = np.clip(now + moves[t], reach.low, reach.high)
    return path


def slow_sines(reach: WinchRange, steps: int, rng: np.random.Generator) -> Floats:
    """Some winches swing to and fro in 1.5 to 3 s."""
    return _sines(reach, steps, rng, (1.5, 3.0), (0.4, 1.0))


def fast_sines(reach: WinchRange, steps: int, rng: np.random.Generator) -> Floats:
    """Some winches swing to and fro in 0.3 to 0.8 s, less far."""
    return _sines(reach, steps, rng, (0.3, 0.8), (0.05, 0.3))


def tightened(reach: WinchRange, steps: int, rng: np.random.Generator) -> Floats:
    """The same strokes repeatedly, while all winches haul in by steps: loose, then tight."""
    stroke = max(2, round(rng.uniform(0.25, 0.5) * steps))
    once = random_steps(reach, stroke, rng) - reach.start
    again = 0.5 * once[np.arange(steps) % stroke]
    level = (np.arange(steps) // stroke) / max(1, (steps - 1) // stroke)
    first, last = rng.uniform(-0.3, 0.3), rng.uniform(0.3, 0.9)
    tension = first + (last - first) * level[:, None]
    return reach.start - tension * (reach.start - reach.low) + again


def one_by_one(reach: WinchRange, steps: int, rng: np.random.Generator) -> Floats:
    """One winch after the other moves in or out and back."""
    winches = len(reach.start)
    each = max(4, round(rng.uniform(0.3, 0.7) / reach.dt))
    order = np.concatenate([rng.permutation(winches) for _ in range(steps // each + 1)])
    wish = np.tile(reach.start, (steps, 1))
    for number, winch in enumerate(order[: steps // each + 1]):
        end = reach.low[winch] if rng.random() < 0.7 else reach.high[winch]
        way = rng.uniform(0.3, 1.0) * (end - reach.start[winch])
        wish[number * each : number * each + each // 2, winch] += way
    return wish


def big_strokes(reach: WinchRange, steps: int, rng: np.random.Generator) -> Floats:
    """Half of the winches haul in as far as they can while the others pay out, then the reverse."""
    hauls = rng.permutation(len(reach.start)) < (len(reach.start) + 1) // 2
    each = max(2, round(rng.uniform(0.4, 1.0) / reach.dt))
    turn = (np.arange(steps) // each % 2 == 0)[:, None]
    far = rng.uniform(0.5, 1.0)
    ends = np.where(turn == hauls, reach.low, reach.high)
    return reach.start + far * (ends - reach.start)


def holds(reach: WinchRange, steps: int, rng: np.random.Generator) -> Floats:
    """Some winches jump to other lengths and stay there for a long time."""
    each = max(2, round(rng.uniform(0.7, 1.5) / reach.dt))
    shape = (steps // each + 1, len(reach.start))
    places = rng.uniform(reach.low, reach.high, shape)
    jumps = rng.random(shape) < 0.6
    if not jumps[: -(-steps // each)].any():
        jumps[0, rng.integers(shape[1])] = True
    places = np.where(jumps, places, reach.start)
    return places[np.arange(steps) // each]


def _sines(
    reach: WinchRange,
    steps: int,
    rng: np.random.Generator,
    periods: tuple[float, float],
    amplitudes: tuple[float, float],
) -> Floats:
    """Around the middle of the range or the start, one or more winches, together or each by itself."""
    winches = len(reach.start)
    together = rng.random() < 0.3
    period = np.broadcast_to(rng.uniform(*periods, 1 if together else winches), winches)
    phase = np.broadcast_to(rng.uniform(0, 2 * np.pi, 1 if together else winches), winches)
    moving = rng.random(winches) < rng.choice([0.35, 0.7, 1.0])
    if not moving.any():
        moving[rng.integers(winches)] = True
    half = (reach.high - reach.low) / 2 * rng.uniform(*amplitudes, winches) * moving
    middle = reach.start + rng.uniform(0, 1) * ((reach.low + reach.high) / 2 - reach.start)
    time = reach.dt * np.arange(1, steps + 1)[:, None]
    return middle + half * np.sin(2 * np.pi * time / period + phase)


FAMILIES: dict[str, Family] = {
    PLAIN: random_steps,
    "slow_sines": slow_sines,
    "fast_sines": fast_sines,
    "tightened": tightened,
    "one_by_one": one_by_one,
    "big_strokes": big_strokes,
    "holds": holds,
}


def varied(
    reach: WinchRange, path: Floats, other: Floats, width: float, rng: np.random.Generator
) -> Floats:
    """A variation of a path (T, W) [m]: some winches take another path's, some are moved at knots.

    Args:
      reach: range of the winches.
      path, other: (T, W) [m].
      width: of the moves, as a fraction of the range.
      rng: source of randomness.
    """
    steps, winches = path.shape
    taken = rng.random(winches) < rng.choice([0.0, 0.0, 0.3])
    mixed = np.where(taken, other, path)
    every = max(1, round(rng.uniform(0.15, 0.8) / reach.dt))
    knots = np.arange(0, steps + every, every)
    moves = rng.normal(0.0, width, (len(knots), winches)) * (rng.random(winches) < 0.6)
    place = np.arange(steps) / every
    low = place.astype(int)
    share = (place - low)[:, None]
    smooth = (1 - share) * moves[low] + share * moves[np.minimum(low + 1, len(knots) - 1)]
    return mixed + smooth * (reach.high - reach.low)
