"""Tasks that ask the robot to go somewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flywheel.errors import ConfigError
from flywheel.records import Floats
from flywheel.robots import Box, Robot
from flywheel.tasks.config import TaskConfig
from flywheel.tasks.costs import Arrival, Broadside, Collision, FinalDistance, MeanDistance
from flywheel.tasks.distance import Grid, StraightLine, grid_around, in_the_way, near_boxes
from flywheel.tasks.rolling import rolling_ways
from flywheel.tasks.task import Distance, Task

ATTEMPTS = 200  # draws of goal and boxes before a course counts as impossible
MARGIN = 2.0  # margin of ground around start, goal and boxes [robot lengths]


def reach(robot: Robot, start: Floats, rng: np.random.Generator, config: TaskConfig) -> Task:
    """A goal on open ground."""
    goal = drawn_goal(robot, robot.center_weights @ start[:, :2], rng, config)
    return going("reach", robot, goal, StraightLine(goal), config)


def reach_among_boxes(
    robot: Robot, start: Floats, rng: np.random.Generator, config: TaskConfig
) -> Task:
    """A goal behind boxes, which the robot has to go around; drawn until it can be reached."""
    here, why = robot.center_weights @ start[:, :2], ""
    for _ in range(ATTEMPTS):
        goal = drawn_goal(robot, here, rng, config)
        boxes = config.obstacles or _boxes(robot, here, goal, rng, config)
        try:
            check_start(robot, start, boxes)
            ways = ways_to(goal, here, boxes, robot, config)
            return going("reach_among_boxes", robot, goal, ways, config, boxes)
        except ConfigError as error:
            why = str(error)
    raise ConfigError(
        f"No course could be drawn in {ATTEMPTS} attempts; the last one failed: {why} Allow goals "
        "farther away (radius), fewer or smaller boxes, or less clearance."
    )


def going(
    name: str,
    robot: Robot,
    goal: Floats,
    to_goal: Distance,
    config: TaskConfig,
    boxes: tuple[Box, ...] = (),
) -> Task:
    """Go to a goal (2,), straight or by paths around boxes."""
    return Task(
        name=name,
        robot=robot,
        goal=goal,
        tolerance=config.tolerance * robot.length,
        seconds=config.seconds,
        to_goal=to_goal,
        costs=(
            MeanDistance(config.along),
            FinalDistance(config.final),
            Broadside(config.broadside),
            Arrival(config.arrival),
            *([Collision(config.near)] if boxes else []),
        ),
        obstacles=boxes,
    )


def with_turns(task: Task, start: Floats, here: Floats, config: TaskConfig) -> Task:
    """A task from `here` (2,), and those after it, with distances for a robot that rolls across its axis.

    Args:
      task: without them.
      start: (P, 3) tracked points of the standing robot [m].
      here: (2,) its place at the beginning [m].
      config: of the task.
    """
    grid, robot = task.to_goal, task.robot
    if not isinstance(grid, Grid):
        grid = ways_to(task.goal, here, task.obstacles, robot, config)
    rolling = rolling_ways(grid, start, config.turn * robot.length, config.aside)
    then = None if task.then is None else with_turns(task.then, start, task.goal, config)
    return replace(task, rolling=rolling, then=then)


def drawn_goal(robot: Robot, here: Floats, rng: np.random.Generator, config: TaskConfig) -> Floats:
    """(2,) the given goal, or one at a distance from `here` (2,)."""
    if config.goal is not None:
        return np.array(config.goal)
    radius, bearing = rng.uniform(*config.radius), rng.uniform(-np.pi, np.pi)
    return here + radius * robot.length * np.array([np.cos(bearing), np.sin(bearing)])


def ways_to(
    goal: Floats, here: Floats, boxes: tuple[Box, ...], robot: Robot, config: TaskConfig
) -> Grid:
    """Shortest paths to a goal (2,) around boxes, over ramps and under ceilings, on ground that holds all of
    them [m].

    Raises:
      ConfigError: the goal lies in a box or too close to one, or cannot be reached from `here`.
    """
    places = np.stack([goal, here, *(corner[:2] for box in boxes for corner in box.corners)])
    margin = MARGIN * robot.length
    ways = grid_around(
        goal,
        in_the_way(boxes, config.headroom * robot.length),
        low=places.min(axis=0) - margin,
        high=places.max(axis=0) + margin,
        cell=config.cell * robot.length,
        clearance=config.clearance * robot.length,
        moves=config.moves,
    )
    if not ways.reaches(here):
        raise ConfigError(
            f"No path leads from ({here[0]:.3g}, {here[1]:.3g}) to the goal ({goal[0]:.3g}, "
            f"{goal[1]:.3g}) with {config.clearance:.3g} L of clearance from the boxes."
        )
    return ways


def _boxes(
    robot: Robot, here: Floats, goal: Floats, rng: np.random.Generator, config: TaskConfig
) -> tuple[Box, ...]:
    """Boxes near the straight path, a third to two thirds along it."""
    length, along = robot.length, goal - here
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    height = config.box_height * length / 2
    boxes = []
    for _ in range(config.boxes):
        x, y = here + rng.uniform(0.3, 0.7) * along + rng.uniform(-0.8, 0.8) * length * across
        half = rng.uniform(*config.box_half_width, size=2) * length
        boxes.append(Box(center=(x, y, height), half_size=(half[0], half[1], height)))
    return tuple(boxes)


def check_start(robot: Robot, start: Floats, boxes: tuple[Box, ...]) -> None:
    """Reject boxes that touch a robot with its points at (P, 3), turned about the vertical by any angle.

    Raises:
      ConfigError: one does.
    """
    here: Floats = robot.center_weights @ start
    size = np.linalg.norm(start[:, :2] - here[:2], axis=-1).max()
    radius = max(point.radius for point in robot.points)
    top = start[:, 2].max() + radius
    if any(_touches(box, here, size + radius, top) for box in boxes):
        raise ConfigError(f"An obstacle stands within {size + radius:.3g} m of the robot's start.")


def _touches(box: Box, here: Floats, reach: float, top: float) -> bool:
    """True for a box in the upright cylinder of radius `reach` [m] around (3,), below `top` [m]."""
    if box.tilted:
        return bool(np.linalg.norm(np.maximum(box.beyond(here), 0.0)) <= reach)
    return bool(near_boxes(here[:2], [box], reach)) and box.corners[:, 2].min() <= top
