"""Obstacle courses, from MJCF to task, and tours."""

from pathlib import Path

import numpy as np
import pytest

from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError, RobotError, UnknownNameError
from flywheel.robots import COURSES, ObstacleCourse, Robot, load_course, load_robot
from flywheel.tasks import TaskConfig, sample_task
from flywheel.tasks.distance import in_the_way, near_boxes
from tests import draws

MINE = """<mujoco model="mine"><worldbody>
  <geom type="plane" size="9 9 1"/>
  <geom type="box" pos="5 0 1" size="1 4 1"/>
  <site name="start" pos="0 0 0"/>
  <site name="goal2" pos="10 3 0"/> <site name="goal10" pos="-3 -8 0"/> <site name="goal1" pos="10 -3 0"/>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("icosa6")


@pytest.fixture(scope="module")
def points(robot: Robot) -> np.ndarray:
    plant = Plant(robot)
    return plant.observe(plant.rest()).points[0]


@pytest.mark.parametrize("name", COURSES)
def test_every_course_has_a_way_around_its_walls_and_straight_over_ramps_and_under_ceilings(
    robot, points, name
):
    seed = draws.seed()
    rng = np.random.default_rng(seed)
    task = sample_task("obstacle_course", robot, points, rng, TaskConfig(course=name))
    assert task.begin is not None and task.obstacles == load_course(name).obstacles
    there = task.begin.points(points, robot.center_weights)
    straight, around = task.distance(there), task.to_goal(task.place(there))
    assert task.place(there) == pytest.approx(task.begin.place)
    if name in ("incline", "low_clearance"):
        assert around < 1.09 * straight, seed  # moves to eight neighbours
    else:
        assert around > 1.03 * straight, seed
    walls = in_the_way(task.obstacles, 0.8 * robot.length)
    assert walls or name == "incline"
    assert not near_boxes(there[:, :2], walls, 0.0).any(), seed


def test_a_turned_robot_is_the_same_robot(robot: Robot, points: np.ndarray) -> None:
    seed = draws.seed()
    task = sample_task(
        "obstacle_course", robot, points, np.random.default_rng(seed), TaskConfig(spread=0.0)
    )
    assert task.begin is not None
    assert task.begin.place == pytest.approx(load_course("s_course").start)
    there = task.begin.points(points, robot.center_weights)
    apart, before = (np.linalg.norm(p[:, None] - p[None], axis=-1) for p in (there, points))
    assert apart == pytest.approx(before)
    assert there[:, 2] == pytest.approx(points[:, 2])


def test_ones_own_course_has_goals_in_the_order_of_their_numbers(robot, points, tmp_path):
    file = tmp_path / "mine.xml"
    file.write_text(MINE)
    course = load_course(str(file))
    assert (course.name, course.start, len(course.obstacles)) == ("mine", (0.0, 0.0), 1)
    assert course.goals == ((10.0, -3.0), (10.0, 3.0), (-3.0, -8.0))
    config = TaskConfig(course=str(file), spread=0.0, clearance=0.3)
    task = sample_task("obstacle_course", robot, points, np.random.default_rng(0), config)
    assert task.then is not None and task.then.then is not None and task.then.then.then is None
    assert task.goal == pytest.approx([10, -3]) and task.last_goal == pytest.approx([-3, -8])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('name="start"', 'name="begin"'), "no site named start"),
        (('name="goal', 'name="gaol'), "no site named goal"),
        (('type="box"', 'type="cylinder"'), "nothing else"),
        (("</worldbody>", ""), "is not valid XML"),
    ],
)
def test_what_is_no_course_is_refused(change: tuple[str, str], words: str) -> None:
    with pytest.raises(RobotError, match=words):
        ObstacleCourse.from_mjcf(MINE.replace(*change))


def test_unknown_and_missing_courses_are_named(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="s_course"):
        load_course("s_cours")
    with pytest.raises(RobotError, match="There is no course"):
        load_course(str(tmp_path / "none.xml"))


def test_a_course_too_narrow_for_the_robot_is_refused(robot, points, tmp_path):
    file = tmp_path / "narrow.xml"
    file.write_text(MINE.replace('pos="5 0 1"', 'pos="1.5 0 1"'))
    with pytest.raises(ConfigError, match="could not be placed on the course mine"):
        config = TaskConfig(course=str(file), spread=0.0)
        sample_task("obstacle_course", robot, points, np.random.default_rng(0), config)


def test_a_tour_goes_from_goal_to_goal(robot: Robot, points: np.ndarray) -> None:
    seed = draws.seed()
    config = TaskConfig(stops=4, radius=(1.0, 2.0))
    task = sample_task("tour", robot, points, np.random.default_rng(seed), config)
    goals = [task.place(points)]
    now = task
    while now is not None:
        goals.append(now.goal)
        now = now.then
    legs = np.linalg.norm(np.diff(goals, axis=0), axis=1) / robot.length
    assert len(legs) == 4
    assert (legs > 1.0).all() and (legs < 2.0).all(), seed


@pytest.mark.parametrize("name", ["tour", "obstacle_course"])
def test_a_goal_is_refused_where_the_task_has_its_own(name: str) -> None:
    with pytest.raises(ValueError, match=f"the goals of the task '{name}'"):
        TaskConfig.model_validate({"name": name, "goal": (1.0, 2.0)})
