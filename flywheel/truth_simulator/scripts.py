"""Command scripts for recordings of a robot.

A script draws a desired motion of each winch's rest length, which is kept inside a window around
the keyframe with mostly taut cables, and turned into the robot's commands.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flywheel.records import Floats
from flywheel.registry import lookup
from flywheel.robots import Robot

HAUL_IN, PAY_OUT = 0.4, 0.15  # the window: shares of the keyframe's rest length


@dataclass(frozen=True)
class Reach:
    """Limits of a script for the winches.

    Attributes:
      start, low, high: (W,) position at the keyframe, and the window around it [m].
      speed: (W,) fastest [m/s].
    """

    start: Floats
    low: Floats
    high: Floats
    speed: Floats

    @classmethod
    def of(cls, robot: Robot) -> Reach:
        start = robot.winch_of(robot.keyframe)
        low = np.maximum(robot.rest_low, start * (1 - HAUL_IN))
        high = np.minimum(robot.rest_high, start * (1 + PAY_OUT))
        fastest = np.minimum(robot.control_high, -robot.control_low)
        # A position winch has no speed of its own: through its window in a second.
        return cls(start, low, high, np.where(robot.rate_driven, fastest, high - low))


Wish = Callable[[Reach, int, float, np.random.Generator], Floats]


def script(name: str, robot: Robot, seconds: float, dt: float, rng: np.random.Generator) -> Floats:
    """Commands (T, W) of a script, within the winches' ranges.

    Args:
      name: in `SCRIPTS`.
      robot: of the commands, starting at its keyframe's rest lengths.
      seconds: duration.
      dt: control step [s].
      rng: source of randomness.

    Raises:
      UnknownNameError: no such script.
    """
    wish = lookup(SCRIPTS, name, "script")
    reach = Reach.of(robot)
    steps = round(seconds / dt)
    rates = np.clip(wish(reach, steps, dt, rng), -reach.speed, reach.speed)
    path = [reach.start]
    for rate in rates:
        path.append(np.clip(path[-1] + rate * dt, reach.low, reach.high))
    positions = np.array(path)
    commands = np.where(robot.rate_driven, np.diff(positions, axis=0) / dt, positions[1:])
    return np.asarray(np.clip(commands, robot.control_low, robot.control_high))


def random_steps(reach: Reach, steps: int, dt: float, rng: np.random.Generator) -> Floats:
    """Each winch takes a new random rate, or holds, every 0.3 to 0.8 s."""
    rates = np.zeros((steps, len(reach.start)))
    for winch in range(rates.shape[1]):
        begin = 0
        while begin < steps:
            end = begin + max(1, round(rng.uniform(0.3, 0.8) / dt))
            hold = rng.random() < 0.25
            rates[begin:end, winch] = 0.0 if hold else rng.uniform(-0.8, 0.8) * reach.speed[winch]
            begin = end
    return rates


def slow_sine(reach: Reach, steps: int, dt: float, rng: np.random.Generator) -> Floats:
    """A sine of 2 to 3 s for each winch."""
    return _sine(reach, steps, dt, rng, (2.0, 3.0))


def fast_sine(reach: Reach, steps: int, dt: float, rng: np.random.Generator) -> Floats:
    """A sine of 0.4 to 0.8 s for each winch."""
    return _sine(reach, steps, dt, rng, (0.4, 0.8))


def _sine(
    reach: Reach, steps: int, dt: float, rng: np.random.Generator, periods: tuple[float, float]
) -> Floats:
    count = len(reach.start)
    pulse = 2 * np.pi / rng.uniform(*periods, count)
    phase = rng.uniform(0, 2 * np.pi, count)
    strength = np.minimum(
        rng.uniform(0.4, 0.8, count) * reach.speed, 0.5 * (reach.high - reach.low) * pulse
    )
    time = dt * np.arange(steps)[:, None]
    return np.asarray(strength * np.sin(pulse * time + phase))


def pretension(reach: Reach, steps: int, dt: float, rng: np.random.Generator) -> Floats:
    """All winches haul in together for a while, then follow random motions."""
    rates = random_steps(reach, steps, dt, rng)
    hauling = min(steps, round(rng.uniform(0.5, 0.8) / dt))
    rates[:hauling] = -rng.uniform(0.3, 0.5) * reach.speed
    return rates


def gait(reach: Reach, steps: int, dt: float, rng: np.random.Generator) -> Floats:
    """Big strokes: half of the winches haul in fast, then pay out while the others haul in."""
    rates = np.zeros((steps, len(reach.start)))
    order = rng.permutation(len(reach.start))
    first = np.isin(np.arange(len(order)), order[: (len(order) + 1) // 2])
    begin, hauls = 0, first
    while begin < steps:
        end = begin + max(1, round(rng.uniform(0.5, 0.9) / dt))
        strength = rng.uniform(0.7, 1.0)
        rates[begin:end] = np.where(hauls, -1.0, 1.0) * strength * reach.speed
        begin, hauls = end, ~hauls
    return rates


SCRIPTS: dict[str, Wish] = {
    "random_steps": random_steps,
    "slow_sine": slow_sine,
    "fast_sine": fast_sine,
    "pretension": pretension,
    "gait": gait,
}
