"""Tasks: goals, obstacles, and the cost of a predicted motion."""

from collections.abc import Callable

import numpy as np

from flywheel.errors import ConfigError
from flywheel.records import Floats
from flywheel.registry import lookup
from flywheel.robots import Robot
from flywheel.tasks.config import TaskConfig
from flywheel.tasks.courses import obstacle_course, tour
from flywheel.tasks.distance import Grid, StraightLine, grid_around
from flywheel.tasks.reach import reach, reach_among_boxes, with_turns
from flywheel.tasks.task import Cost, Distance, Stand, Task

TASKS: dict[str, Callable[[Robot, Floats, np.random.Generator, TaskConfig], Task]] = {
    "reach": reach,
    "reach_among_boxes": reach_among_boxes,
    "obstacle_course": obstacle_course,
    "tour": tour,
}


def sample_task(
    name: str, robot: Robot, start: Floats, rng: np.random.Generator, config: TaskConfig
) -> Task:
    """Draw a task for a robot that stands somewhere.

    Args:
      name: as in `TASKS`.
      robot: for the task.
      start: (P, 3) present positions of its tracked points [m].
      rng: source of randomness.
      config: distribution of tasks; its own `name` is ignored.

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
    task = make(robot, start, rng, config)
    if not config.turn:
        return task
    here = robot.center_weights @ start[:, :2] if task.begin is None else task.begin.place
    return with_turns(task, start, here, config)


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
