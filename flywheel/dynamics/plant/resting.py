"""Test for rest: time and place at which a robot settles while its winches hold."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from flywheel.dynamics.plant.plant import Plant
from flywheel.errors import ModelError
from flywheel.records import Floats, State

SETTLING = 5.0  # after which a robot is expected to lie still [s]
WATCHED = 10.0  # twice, of one that does not [s]
PIECE = 0.25  # that is simulated at a time [s]
STILL = 0.02  # robot lengths per second: slower counts as at rest
LOST = 20.0  # robot lengths from where it began: farther counts as gone
FOUND = 1e-3  # robot lengths per second: slower is where it rests
SEARCH = 20.0  # for where it rests [s]
FINER = 8  # times as many frequencies as there are samples
PATIENCE = 60.0  # of a clock on the wall, for the simulation of a few seconds [s]


@dataclass(frozen=True)
class Settling:
    """Motion of a robot from its keyframe, while its winches hold.

    Attributes:
      speed: of its fastest tracked point after `SETTLING` seconds [m/s].
      early, late: root mean squares of its tracked points' speeds in the `WATCHED` seconds after
        that, and in those after these; both `speed` if it lies still [m/s].
      moved: largest distance of a tracked point from its place in the keyframe, at rest or at the
        end [m].
      lost: it has flown away.
      still: it lies still after `SETTLING` seconds.
      rest: (1,) rest state; None if none was found.
      period: of the oscillation that moves its tracked points most [s]; NaN without one.
    """

    speed: float
    early: float
    late: float
    moved: float
    lost: bool
    still: bool
    rest: State | None
    period: float = np.nan

    @property
    def grows(self) -> bool:
        """True if its motion grows by more than the beating of several oscillations can explain."""
        return self.late > 1.2 * self.early

    @property
    def time_constant(self) -> float:
        """Time in which its motion decays to 1/e [s]; infinite without decay."""
        return WATCHED / np.log(self.early / self.late) if self.early > self.late > 0 else np.inf


def settling(plant: Plant, patience: float = PATIENCE) -> Settling:
    """Simulate a robot from its keyframe on.

    Args:
      plant: of the robot.
      patience: longest wall-clock time [s].

    Raises:
      ModelError: the simulation diverged, or it takes longer than that.
    """
    clock = _Clock(plant, patience)
    start, length = plant.rest(), plant.robot.length
    begun = plant.observe(start).points[0]
    state, speeds, _ = _watched(clock, start, SETTLING)
    speed = early = late = float(speeds[-1])
    moved = _apart(plant, state, begun)
    if (still := speed <= STILL * length) or moved > LOST * length:
        return Settling(speed, early, late, moved, moved > LOST * length, still, state)
    rest = _resting_place(clock, start)
    state, speeds, first = _watched(clock, state, WATCHED)
    early = float(np.sqrt((speeds**2).mean()))
    state, speeds, then = _watched(clock, state, WATCHED)
    late = float(np.sqrt((speeds**2).mean()))
    lost = _apart(plant, state, begun) > LOST * length
    moved = _apart(plant, state if rest is None else rest, begun)
    period = _period(np.concatenate([first, then]), plant.dt)
    return Settling(speed, early, late, moved, lost, False, rest, period)


def swing_period(plant: Plant) -> float:
    """Period with which a hanging robot swings about its rest [s]; 0 for one that does not."""
    try:
        found = settling(plant) if plant.robot.tethered else None
    except ModelError:
        return 0.0
    if found is None or found.lost or not np.isfinite(found.period):
        return 0.0
    return found.period


class _Clock:
    """A plant whose winches hold, with a limit on the wall-clock time it may take."""

    def __init__(self, plant: Plant, patience: float) -> None:
        self.plant = plant
        self._began, self._patience, self._done = time.monotonic(), patience, 0.0

    def go(self, state: State, seconds: float) -> Iterator[tuple[State, Floats, Floats]]:
        """States (1, T + 1), the speed of the fastest point (T,) between them [m/s], and the points (T, P, 3)
        after each step, piece by piece.
        """
        plant = self.plant
        hold = plant.robot.holding(plant.winch(state))[:, None]
        steps, left = max(1, round(PIECE / plant.dt)), max(1, round(seconds / plant.dt))
        while left > 0:
            run = plant.simulate(state, np.repeat(hold, min(steps, left), axis=1))
            assert run.states is not None
            points = run.observations.points[0]
            way = np.linalg.norm(np.diff(points, axis=0), axis=-1)
            yield run.states, way.max(axis=1) / plant.dt, points[1:]
            state, left = run.states[:, -1], left - steps
            self._check(steps * plant.dt)

    def _check(self, seconds: float) -> None:
        self._done += seconds
        if (taken := time.monotonic() - self._began) > self._patience:
            raise ModelError(
                f"The simulation of {self.plant.robot.name} is too slow: {self._done:.3g} s took "
                f"{taken:.0f} s. A longer timestep, fewer bodies or fewer contacts make it faster."
            )


def _watched(clock: _Clock, state: State, seconds: float) -> tuple[State, Floats, Floats]:
    """State (1,) after some seconds, and until then the speed of its fastest point (T,) [m/s], and its points
    (T, P, 3).
    """
    speeds, places = [], []
    for states, piece, points in clock.go(state, seconds):
        state = states[:, -1]
        speeds.append(piece)
        places.append(points)
    return state, np.concatenate(speeds), np.concatenate(places)


def _period(points: Floats, dt: float) -> float:
    """Period of the strongest oscillation of points (T, P, 3) [s]; NaN if three do not fit into the time."""
    moved = (points - points.mean(axis=0)).reshape(len(points), -1)
    moved *= np.hanning(len(points))[:, None]
    size = FINER * len(points)
    power = (np.abs(np.fft.rfft(moved, size, axis=0)) ** 2).sum(axis=1)
    least = 3 * FINER
    best = least + int(power[least:].argmax())
    if best in (least, len(power) - 1):
        return np.nan
    below, here, above = np.log(power[best - 1 : best + 2])
    return float(size * dt / (best + (below - above) / (below - 2 * here + above) / 2))


def _resting_place(clock: _Clock, state: State) -> State | None:
    """Rest state (1,) by kinetic damping: velocities are set to zero where the speed peaks."""
    for _ in range(round(SEARCH / PIECE)):
        (states, speeds, _), *_ = clock.go(state, PIECE)
        fastest = int(speeds.argmax())
        if speeds[fastest] < FOUND * clock.plant.robot.length:
            return states[:, -1]
        state = states[:, -1]
        if fastest < len(speeds) - 1:
            state = State(
                states.qpos[:, fastest], np.zeros_like(state.qvel), states.act[:, fastest]
            )
    return None


def _apart(plant: Plant, state: State, points: Floats) -> float:
    """Farthest distance of a tracked point in a state (1,) from its place in (P, 3) [m]."""
    return float(np.linalg.norm(plant.observe(state).points[0] - points, axis=-1).max())
