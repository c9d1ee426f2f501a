"""Tasks along a path: through an obstacle course, or from goal to goal on open ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flywheel.errors import ConfigError
from flywheel.records import Floats
from flywheel.robots import ObstacleCourse, Robot, load_course
from flywheel.tasks.config import TaskConfig
from flywheel.tasks.distance import StraightLine
from flywheel.tasks.reach import ATTEMPTS, check_start, drawn_goal, going, ways_to
from flywheel.tasks.task import Stand, Task


def obstacle_course(
    robot: Robot, start: Floats, rng: np.random.Generator, config: TaskConfig
) -> Task:
    """A course from an MJCF, from near its start to near each of its goals."""
    course, why = load_course(config.course), ""
    for _ in range(ATTEMPTS):
        here = _around(course.start, robot, rng, config)
        begin = Stand(here, float(rng.uniform(-np.pi, np.pi)))
        goals = [_around(goal, robot, rng, config) for goal in course.goals]
        try:
            points = begin.points(start, robot.center_weights)
            check_start(robot, points, course.obstacles)
            return replace(_through(course, robot, here, goals, config), begin=begin)
        except ConfigError as error:
            why = str(error)
    raise ConfigError(
        f"{robot.name} could not be placed on the course {course.name}, in {ATTEMPTS} attempts; "
        f"the last one failed: {why} Use a wider course, or less spread or clearance."
    )


def tour(robot: Robot, start: Floats, rng: np.random.Generator, config: TaskConfig) -> Task:
    """Goals on open ground, one after the other."""
    here: Floats = robot.center_weights @ start[:, :2]
    goals = []
    for _ in range(config.stops):
        here = drawn_goal(robot, here, rng, config)
        goals.append(here)
    task: Task | None = None
    for goal in reversed(goals):
        task = replace(going("tour", robot, goal, StraightLine(goal), config), then=task)
    assert task is not None, "a tour has at least one stop"
    return task


def _through(
    course: ObstacleCourse, robot: Robot, here: Floats, goals: Sequence[Floats], config: TaskConfig
) -> Task:
    """The path from `here` (2,) to one goal after the other."""
    goal, *later = goals
    ways = ways_to(goal, here, course.obstacles, robot, config)
    task = going("obstacle_course", robot, goal, ways, config, course.obstacles)
    return replace(task, then=_through(course, robot, goal, later, config)) if later else task


def _around(
    place: tuple[float, float], robot: Robot, rng: np.random.Generator, config: TaskConfig
) -> Floats:
    """(2,) a random place in a disc around a place of the course."""
    radius = config.spread * robot.length * np.sqrt(rng.uniform())
    bearing = rng.uniform(-np.pi, np.pi)
    return np.array(place) + radius * np.array([np.cos(bearing), np.sin(bearing)])
