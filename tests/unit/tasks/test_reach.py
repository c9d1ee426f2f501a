import dataclasses

import numpy as np
import pytest
from pydantic import ValidationError

from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError, UnknownNameError
from flywheel.robots import Box, Robot
from flywheel.tasks import TaskConfig, sample_task
from flywheel.tasks.costs import Broadside, Collision, FinalDistance, MeanDistance, gap
from flywheel.tasks.reach import check_start
from tests import draws


@pytest.fixture(scope="module")
def start(robot: Robot) -> np.ndarray:
    plant = Plant(robot)
    return plant.observe(plant.rest()).points[0]


def drawn(robot: Robot, start: np.ndarray, name: str = "reach", seed: int = 0, **changes):
    return sample_task(name, robot, start, np.random.default_rng(seed), TaskConfig(**changes))


def still(points: np.ndarray, steps: int = 3) -> np.ndarray:
    return np.repeat(points[None, None], steps + 1, axis=1)


def test_the_centre_is_that_of_mass(robot: Robot, start: np.ndarray) -> None:
    # a rod's centre of mass is midway between its caps, and all rods weigh the same
    assert robot.center_weights @ start == pytest.approx(start.mean(axis=0))
    assert robot.center_weights.sum() == pytest.approx(1.0)


def test_heavier_bodies_draw_the_centre_to_them(robot: Robot, start: np.ndarray) -> None:
    heavy = dataclasses.replace(robot.bodies[0], mass=3 * robot.bodies[0].mass)
    uneven = dataclasses.replace(robot, bodies=(heavy, *robot.bodies[1:]))
    middles = np.stack([start[list(body.points)].mean(axis=0) for body in robot.bodies])
    expected = np.average(middles, axis=0, weights=[3, 1, 1])
    assert uneven.center_weights @ start == pytest.approx(expected)


def test_a_centre_of_mass_off_the_middle_of_its_points_is_found(robot: Robot) -> None:
    body = robot.bodies[0]
    ends = np.stack([robot.points[p].offset for p in body.points])
    shifted = dataclasses.replace(body, com=0.3 * ends[0] + 0.7 * ends[1])
    weights = dataclasses.replace(robot, bodies=(shifted, *robot.bodies[1:])).center_weights
    assert weights[list(body.points)] * 3 == pytest.approx([0.3, 0.7])


def test_the_goal_lies_as_far_away_as_configured(robot: Robot, start: np.ndarray) -> None:
    for seed in range(20):
        task = drawn(robot, start, seed=seed, radius=(1.5, 2.5))
        assert 1.5 <= task.distance(start) / robot.length <= 2.5
        assert not task.reached(start)


def test_the_goal_is_reached_within_the_tolerance_of_the_centre(robot, start):
    task = drawn(robot, start)
    way = np.append(task.goal - task.place(start), 0.0)
    unit = way / np.linalg.norm(way)
    assert task.reached(start + way - 0.99 * task.tolerance * unit)
    assert not task.reached(start + way - 1.01 * task.tolerance * unit)


def test_a_given_goal_is_taken(robot: Robot, start: np.ndarray) -> None:
    assert drawn(robot, start, goal=(7.0, -2.0)).goal.tolist() == [7.0, -2.0]


def test_a_cost_is_the_sum_of_its_terms_and_of_no_terms_zero(robot, start):
    rng = np.random.default_rng(seed := draws.seed())
    task = drawn(robot, start, "reach_among_boxes", seed=1)
    points = still(start) + rng.normal(scale=0.3, size=(5, 4, *start.shape))
    parts = [dataclasses.replace(task, costs=(term,)).cost(points) for term in task.costs]
    assert len(parts) >= 4
    np.testing.assert_allclose(task.cost(points), sum(parts), err_msg=f"seed {seed}")
    assert dataclasses.replace(task, costs=()).cost(points).tolist() == [0.0] * 5


def test_distance_costs_count_in_robot_lengths(robot: Robot, start: np.ndarray) -> None:
    task = drawn(robot, start)
    expected = task.distance(start) / robot.length
    for term in (MeanDistance(2.0), FinalDistance(2.0)):
        assert term(still(start), task) == pytest.approx(2 * expected)


def test_the_final_distance_looks_at_the_end_only(robot: Robot, start: np.ndarray) -> None:
    task = drawn(robot, start)
    points = still(start)
    points[:, :-1] += 5.0
    assert FinalDistance(1.0)(points, task) == FinalDistance(1.0)(still(start), task)
    assert MeanDistance(1.0)(points, task) != MeanDistance(1.0)(still(start), task)


def test_lying_along_the_way_costs_more_than_lying_across(robot: Robot, start: np.ndarray) -> None:
    task = drawn(robot, start, goal=(20.0, 0.0))
    along = np.zeros_like(start)
    along[:, 0] = np.linspace(-1, 1, len(start))
    across = along[:, [1, 0, 2]]
    term = Broadside(1.0)
    assert term(still(along), task) == pytest.approx(1.0)
    assert term(still(across), task) == pytest.approx(0.0, abs=1e-3)
    near = still(along + np.array([20.0 - 0.1 * robot.length, 0, 0]))
    assert term(near, task) == pytest.approx(0.1)  # at the goal it does not matter how one lies


def test_the_gap_is_from_surface_to_surface(robot: Robot) -> None:
    box = Box(center=(0.0, 0.0, 0.0), half_size=(1.0, 1.0, 1.0))
    points = np.full((len(robot.points), 3), 50.0)
    points[2] = (3.0, 0.0, 0.5)
    assert gap(points, robot, (box,)) == pytest.approx(2.0 - robot.points[2].radius)
    points[2] = (2.0, 2.0, 0.0)
    assert gap(points, robot, (box,)) == pytest.approx(np.sqrt(2) - robot.points[2].radius)
    assert gap(points, robot, ()) == np.inf


def test_the_collision_term_is_the_weight_over_the_gap_and_finite_inside(robot: Robot) -> None:
    box = Box(center=(0.0, 0.0, 0.0), half_size=(1.0, 1.0, 1.0))
    points = np.full((len(robot.points), 3), 50.0)
    points[0] = (1.0 + robot.points[0].radius + 0.5 * robot.length, 0.0, 0.0)
    start = points + 100.0
    task = drawn(
        robot, start, "reach_among_boxes", obstacles=(box,), goal=(30.0, 30.0), clearance=0
    )
    assert Collision(3.0)(still(points), task) == pytest.approx(3.0 / 0.5)
    points[0] = 0.0
    assert np.isfinite(Collision(3.0)(still(points), task)).all()


def test_among_boxes_the_way_is_no_shorter_than_the_straight_line(robot, start):
    longer = []
    for seed in range(8):
        task = drawn(robot, start, "reach_among_boxes", seed=seed)
        assert task.obstacles
        straight, way = task.distance(start), task.to_goal(task.place(start))
        assert way >= straight - 1e-6
        longer.append(way / straight)
    assert max(longer) > 1.1, "no box ever stands in the way"


def test_boxes_never_stand_on_the_robot(robot: Robot, start: np.ndarray) -> None:
    for seed in range(8):
        task = drawn(robot, start, "reach_among_boxes", seed=seed)
        assert gap(start, robot, task.obstacles) > 0


@pytest.mark.slow
def test_a_goal_behind_walls_is_refused_with_the_reason(robot: Robot, start: np.ndarray) -> None:
    walls = tuple(
        Box(center=(x, y, 1), half_size=(hx, hy, 1))
        for x, y, hx, hy in ((5, 0, 0.5, 5), (-5, 0, 0.5, 5), (0, 5, 5, 0.5), (0, -5, 5, 0.5))
    )
    with pytest.raises(ConfigError, match="No path leads from .* to the goal"):
        drawn(robot, start, "reach_among_boxes", obstacles=walls, goal=(12.0, 0.0))


def test_an_obstacle_on_the_start_is_refused(robot: Robot, start: np.ndarray) -> None:
    box = Box(center=(0.0, 0.0, 1.0), half_size=(1.0, 1.0, 1.0))
    with pytest.raises(ConfigError, match="of the robot's start"):
        drawn(robot, start, "reach_among_boxes", obstacles=(box,))


@pytest.mark.parametrize(
    ("box", "stands"),
    [
        (Box(center=(0, 0, 9), half_size=(3, 3, 0.5)), False),  # a ceiling
        (Box(center=(0, 0, 1), half_size=(3, 3, 0.5)), True),
        (
            Box(center=(1.5, 0, 0), half_size=(3, 3, 0.5), quaternion=(0.96, 0, -0.28, 0)),
            True,
        ),  # a ramp
        (Box(center=(9, 0, 0), half_size=(3, 3, 0.5), quaternion=(0.96, 0, -0.28, 0)), False),
    ],
)
def test_a_robot_starts_under_a_ceiling_and_before_a_ramp_but_in_neither(robot, start, box, stands):
    if stands:
        with pytest.raises(ConfigError, match="of the robot's start"):
            check_start(robot, start, (box,))
    else:
        check_start(robot, start, (box,))


def test_touching_a_ramp_costs_nothing(robot: Robot, start: np.ndarray) -> None:
    wall = Box(center=(0, 0, 0), half_size=(1, 1, 1))
    ramp = wall.model_copy(update={"quaternion": (0.8, 0.0, -0.6, 0.0)})
    task = drawn(robot, start)
    cost = [
        Collision(3.0)(still(start), dataclasses.replace(task, obstacles=(b,)))
        for b in (wall, ramp)
    ]
    assert cost[0] > 0 and cost[1] == 0


def test_unknown_tasks_and_wrong_starts_are_refused(robot: Robot, start: np.ndarray) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'reach'"):
        drawn(robot, start, "reech")
    with pytest.raises(ConfigError, match=r"6 finite points .* shape \(5, 3\)"):
        drawn(robot, start[:5])
    with pytest.raises(ConfigError, match="finite"):
        drawn(robot, np.full_like(start, np.nan))


@pytest.mark.parametrize(
    "wrong",
    [{"radius": (0.1, 2.0)}, {"radius": (2.0, 1.0)}, {"box_half_width": (0.0, 1.0)}, {"alpha": 1}],
)
def test_a_wrong_configuration_is_refused(wrong: dict) -> None:
    with pytest.raises(ValidationError):
        TaskConfig(**wrong)
