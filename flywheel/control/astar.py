"""A* over whole cycles of gaits: the baseline beside which MPPI is measured."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import count, pairwise

import numpy as np

from flywheel.control.gaits import PATTERNS, Gait, refuse_other_robots
from flywheel.control.protocol import Command
from flywheel.dynamics.plant import Plant, PlantDynamics
from flywheel.errors import ConfigError
from flywheel.records import Floats, Past
from flywheel.robots import Robot
from flywheel.tasks import Task

SETTLE_SECONDS = 2.0  # before a gait is measured
MEASURED = 4  # cycles of each gait: one from rest, and one on each of the robot's three sides
PLACES = 10  # on the path of a cycle, where obstacles and arrival are checked
# Of paths on a grid of 8 neighbours, relative to the straight line; with 4, plans need not be the fastest.
LONGEST = 1 / math.cos(math.pi / 8)
ASTRAY = 1000.0  # cost of leaving the paths that keep clear of obstacles [s/m]: a last resort
SAME_PLACE, HEADINGS = 0.1, 36  # poses that count as one: side of a square [L], sectors of a turn
BATCH = 32  # poses whose continuations are computed at once
EXPANSIONS = 20_000  # poses, after which a search ends: a second
# Weights of the time that is left in a search, each tried if the one before has ended without a way to the
# goal: a sequence takes at most as many times as long as the fastest one.
GREED = 1.0, 2.0, 4.0
SHOWN = 40  # places of a plan that a video shows


@dataclass(frozen=True)
class Cycles:
    """Motions of the robot in one cycle of each of C gaits: from rest [0], and after another such cycle [1].

    Attributes:
      gaits: their names, as in `PATTERNS`.
      paths: (2, C, M, 2) of the centre of mass, relative to its place and heading before the cycle [m].
      turns: (2, C) counter-clockwise [rad].
      seconds: (2, C) durations.
    """

    gaits: tuple[str, ...]
    paths: Floats
    turns: Floats
    seconds: Floats

    @classmethod
    def measured(cls, plant: Plant) -> Cycles:
        """The motions on the plane in the first cycle from rest, and the median of the next ones.

        Raises:
          ModelError: the plant diverged.
        """
        every = [_measured(plant.on(None), gait) for gait in PATTERNS]
        paths, turns, seconds = (
            np.array(
                [
                    [first[part] for first, *_ in every],
                    [np.median([cycle[part] for cycle in later], axis=0) for _, *later in every],
                ]
            )
            for part in range(3)
        )
        return cls(tuple(PATTERNS), paths, turns, seconds)


@dataclass(frozen=True)
class Step:
    """The last cycle of a sequence.

    Attributes:
      gait: its name; "" at rest.
      path: (M, 2) of the centre of mass, up to its end [m].
      heading: at its end [rad].
      cost: duration of the sequence, and what was astray [s].
      rest: at least needed from there to the goal [s].
      arrives: True if the goal lies on the path.
      before: the sequence without this cycle; None at the start.
    """

    gait: str
    path: Floats
    heading: float
    cost: float = 0.0
    rest: float = math.inf
    arrives: bool = False
    before: Step | None = None

    @property
    def sequence(self) -> list[Step]:
        """The start and all cycles."""
        steps = [self]
        while (before := steps[-1].before) is not None:
            steps.append(before)
        return steps[::-1]


def fastest(task: Task, cycles: Cycles, pose: Floats, gait: str = "") -> Step:
    """The fastest sequence of cycles from a pose (3,) to the goal, during a gait or from rest.

    Where no search of `GREED` arrives, the sequence that ends nearest to it.
    """
    found = []
    for greed in GREED:
        found.append(_searched(task, cycles, Step(gait, pose[None, :2], float(pose[2])), greed))
        if found[-1].arrives:
            break
    return min(found, key=lambda step: step.rest)


def _searched(task: Task, cycles: Cycles, start: Step, greed: float) -> Step:
    """The sequence found with a weight of the time left, or the one that comes nearest to the goal."""
    nearest = start
    number, seen, queue = count(), set[tuple[int, ...]](), [(0.0, -1, start)]
    while len(seen) < EXPANSIONS and queue:
        batch: list[Step] = []
        while queue and len(batch) < BATCH and not (batch and queue[0][2].arrives):
            step = heappop(queue)[2]
            if step.arrives:
                return step
            x, y = step.path[-1] / (SAME_PLACE * task.robot.length)
            key = round(x), round(y), round(step.heading / math.tau * HEADINGS) % HEADINGS
            if key not in seen:
                seen.add(key)
                batch.append(step)
        nearest = min((nearest, *batch), key=lambda each: each.rest)
        for after in _further(task, cycles, batch):
            heappush(queue, (after.cost + greed * after.rest, next(number), after))
    return nearest


def _further(task: Task, cycles: Cycles, steps: list[Step]) -> Iterator[Step]:
    """Each sequence with each of the cycles added."""
    gaits, here = np.arange(len(cycles.gaits)), np.array([step.path[-1] for step in steps])
    again = np.array([[gait == step.gait for gait in cycles.gaits] for step in steps], int)
    headings = np.array([step.heading for step in steps])
    turned = np.einsum("nij,ncmj->ncmi", _rotations(headings), cycles.paths[again, gaits])
    paths = here[:, None, None] + turned
    astray = task.to_goal.astray(paths).max(axis=2) - task.to_goal.astray(here)[:, None]
    costs = cycles.seconds[again, gaits] + ASTRAY * np.maximum(astray, 0.0)
    arrives = (np.linalg.norm(paths - task.goal, axis=-1) <= task.tolerance).any(axis=2)
    left = np.maximum(task.to_goal(paths[:, :, -1]) / LONGEST - task.tolerance, 0.0)
    ways = np.linalg.norm(cycles.paths, axis=-1).max(axis=2)
    rests = np.where(arrives, 0.0, left / (ways / cycles.seconds).max())
    turns = headings[:, None] + cycles.turns[again, gaits]
    for n, step in enumerate(steps):
        for c, gait in enumerate(cycles.gaits):
            cost, rest = float(step.cost + costs[n, c]), float(rests[n, c])
            yield Step(gait, paths[n, c], turns[n, c], cost, rest, bool(arrives[n, c]), step)


class AStar:
    """Searches for cycles of gaits to the goal, and walks one before it searches again (prism3).

    Args:
      dynamics: the plant on which the gaits are measured before the first search, on the plane.
      name: for provenance.

    Raises:
      ConfigError: the robot has no gaits.
    """

    model, history = "", 0

    def __init__(self, dynamics: PlantDynamics, name: str = "astar") -> None:
        refuse_other_robots(dynamics.robot)
        self.dynamics, self.name = dynamics, name
        self._cycles: Cycles | None = None
        self.reset(None, 0)

    def reset(self, task: Task | None, seed: int) -> None:
        """Start an episode from rest."""
        self._task, self._during = task, ""
        self._gait = Gait(self.dynamics.robot, "roll", self.dynamics.dt)

    def act(self, past: Past) -> Command:
        """The command for one control step; at the beginning of a cycle, after a search.

        Raises:
          ConfigError: there is no task.
          ModelError: the plant diverged while gaits were measured on it.
        """
        if self._task is None:
            raise ConfigError("A* needs a task; call reset with one first.")
        if not self._gait.begins_cycle:
            return self._gait.act(past)
        self._cycles = self._cycles or Cycles.measured(self.dynamics.plant)
        robot, begun = self.dynamics.robot, time.perf_counter()
        pose = _pose(robot, self._gait.points)
        found = fastest(self._task, self._cycles, pose, self._during).sequence
        taken, path = time.perf_counter() - begun, np.concatenate([step.path for step in found])
        self._during = found[1].gait
        if self._gait.name != f"gait:{self._during}":  # another one begins with rest
            self._gait, self._during = Gait(robot, self._during, self.dynamics.dt), ""
        shown = path[np.linspace(0, len(path) - 1, SHOWN).round().astype(int)]
        return replace(self._gait.act(past), plan_seconds=taken, diagnostics={"paths": shown[None]})


def _pose(robot: Robot, points: Floats) -> Floats:
    """(3,) place [m] and heading [rad] of prism3 with its caps at (P, 3): along its rods, on average."""
    along = (points[1::2] - points[::2]).sum(axis=0)
    return np.append(robot.center_weights @ points[:, :2], np.arctan2(along[1], along[0]))


def _measured(plant: Plant, name: str) -> list[tuple[Floats, float, float]]:
    """Path (PLACES, 2), turn and duration of each of a gait's first cycles."""
    gait, course = Gait(plant.robot, name, plant.dt), plant.begin(plant.settle(SETTLE_SECONDS))
    seen, nothing = plant.observe(course.state[:, None]), np.zeros((1, 0, len(plant.robot.winches)))
    poses: list[Floats] = []
    begins: list[int] = []
    while len(begins) <= MEASURED:
        if gait.begins_cycle:
            begins.append(len(poses) if begins else 0)
        poses.append(_pose(plant.robot, seen.points[0, 0]))
        controls = gait.act(Past(seen, nothing, seen.winch)).controls
        seen = course.go(controls[None]).observations[:, -1:]
    track = np.array(poses)
    track[:, 2] = np.unwrap(track[:, 2])
    found = []
    for first, last in pairwise(begins):
        rows = np.linspace(first, last, PLACES + 1).round().astype(int)[1:]
        moved = track[rows] - track[first]
        path = moved[:, :2] @ _rotations(track[first, 2])
        found.append((path, float(moved[-1, 2]), (last - first) * plant.dt))
    return found


def _rotations(angles: Floats) -> Floats:
    """Matrices (..., 2, 2) of angles (...) [rad]."""
    cosine, sine = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
