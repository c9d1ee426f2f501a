"""Tasks: goals, obstacles, and what a predicted motion costs."""

from collections.abc import Callable

import numpy as np

from flywheel.errors import ConfigError
from flywheel.records import Floats
from flywheel.registry import lookup
from flywheel.robots import Robot
from flywheel.tasks.config import TaskConfig
from flywheel.tasks.courses import obstacle_course, tour
from flywheel.tasks.distance import Grid, StraightLine, grid_around
from flywheel.tasks.reach import reach, reach_among_boxes
from flywheel.tasks.task import Cost, Distance, Stand, Task

TASKS: dict[str, Callable[[Robot, Floats, np.random.Generator, TaskConfig], Task]] = {
    "reach": reach,
    "reach_among_boxes": reach_among_boxes,
    "obstacle_course": obstacle_course,
    "tour": tour,
}


def sample_task(
    name: str,
    robot: Robot,
    start: Floats,
    rng: np.random.Generator,
    config: TaskConfig,
) -> Task:
    """Draw a task for a robot that stands somewhere.

    Args:
      name: as in `TASKS`.
      robot: that it is for.
      start: (P, 3) where its tracked points are [m].
      rng: source of all chance.
      config: what to draw from; its own `name` is not looked at.

    Raises:
      UnknownNameError: no such task.
      ConfigError: no goal can be reached under this configuration.
    """
    make = lookup(TASKS, name, "task")
    if start.shape != (len(robot.points), 3) or not np.isfinite(start).all():
        raise ConfigError(
            f"A task starts from {len(robot.points)} finite points (P, 3) of {robot.name}, got an "
            f"array of shape {start.shape}."
        )
    return make(robot, start, rng, config)


__all__ = [
    "TASKS",
    "Cost",
    "Distance",
    "Grid",
    "Stand",
    "StraightLine",
    "Task",
    "TaskConfig",
    "grid_around",
    "sample_task",
]
