"""A robot whose physics is one line: all points ride on the first two winches."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from flywheel.records import Observation, Past, Rollout
from flywheel.robots import Robot
from flywheel.tasks import Task, TaskConfig, sample_task

DT = 0.1


@dataclass
class Gantry:
    """Points move with winches 0 and 1, along x and y, `speed` metres per metre paid out."""

    robot: Robot
    dt: float = DT
    history: int = 0
    speed: float = 3.0

    def rollout(self, past: Past, controls: np.ndarray) -> Rollout:
        start = np.broadcast_to(past.winch[:, -1], (len(controls), controls.shape[2]))
        winch = self.robot.dead_reckon(start, controls, self.dt)
        moved = self.speed * (winch - winch[:, :1])[..., :2]
        points = past.observations.points[:, -1][:, None] + np.zeros((*moved.shape[:2], 1, 1))
        points[..., :2] += moved[:, :, None]
        return Rollout(points, winch)


@pytest.fixture(scope="session")
def servo(robot: Robot) -> Robot:
    """The same robot with winches that are told positions, in the place of rates."""
    winches = tuple(
        replace(w, kind="position", control_range=w.rest_range, time_constant=0.05)
        for w in robot.winches
    )
    return replace(robot, winches=winches)


@pytest.fixture
def gantry(robot: Robot) -> Gantry:
    return Gantry(robot)


@pytest.fixture(scope="session")
def points(robot: Robot) -> np.ndarray:
    return np.random.default_rng(5).uniform(-1, 1, (len(robot.points), 3)) * robot.length


@pytest.fixture(scope="session")
def task(robot: Robot, points: np.ndarray) -> Task:
    # within what winches that begin in the middle of their range can reach
    place = points[:, :2].mean(axis=0)
    config = TaskConfig(goal=tuple(place + (1.5, -1.2)))
    return sample_task("reach", robot, points, np.random.default_rng(0), config)


@pytest.fixture
def past(robot: Robot, points: np.ndarray) -> Past:
    winch = ((robot.rest_low + robot.rest_high) / 2)[None, None]
    return Past(
        Observation(points[None, None], np.full_like(winch, np.nan)),
        np.empty((1, 0, len(robot.winches))),
        winch,
    )
