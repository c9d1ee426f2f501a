"""What holds for every task, on every robot that stands on the ground."""

import dataclasses

import numpy as np
import pytest

from flywheel.dynamics.plant import Plant
from flywheel.robots import ROBOTS, load_robot
from flywheel.tasks import TASKS, Task, TaskConfig, sample_task
from tests import draws

GROUNDED = [name for name in sorted(ROBOTS) if load_robot(name).grounded]


@pytest.fixture(scope="module", params=[(t, r) for t in sorted(TASKS) for r in GROUNDED], ids=str)
def drawn(request: pytest.FixtureRequest) -> tuple[Task, np.ndarray, int]:
    name, robot = request.param[0], load_robot(request.param[1])
    plant = Plant(robot)
    start = plant.observe(plant.rest()).points[0]
    seed = draws.seed()
    task = sample_task(name, robot, start, np.random.default_rng(seed), TaskConfig())
    return task, start, seed


def motions(task: Task, start: np.ndarray, seed: int, batch: int = 6) -> np.ndarray:
    """Points (B, 11, P, 3) that wander from the start, some through obstacles and the goal."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(scale=0.3, size=(batch, 11, 1, 3)).cumsum(axis=1) * task.robot.length
    points = start + ways
    points[0] = start + np.append(task.goal - task.place(start), 0.0)  # stays at the goal
    return points


@pytest.mark.slow
def test_the_same_chance_draws_the_same_task(drawn: tuple[Task, np.ndarray, int]) -> None:
    task, start, seed = drawn
    again = sample_task(task.name, task.robot, start, np.random.default_rng(seed), TaskConfig())
    other = sample_task(task.name, task.robot, start, np.random.default_rng(seed + 1), TaskConfig())
    np.testing.assert_array_equal(again.goal, task.goal)
    assert again.obstacles == task.obstacles
    assert not np.array_equal(other.goal, task.goal)


def test_it_is_not_done_at_the_start_and_done_at_the_goal(drawn):
    task, start, seed = drawn
    assert not task.reached(start), seed
    assert task.reached(start + np.append(task.goal - task.place(start), 0.0)), seed


def test_costs_are_finite_anywhere(drawn: tuple[Task, np.ndarray, int]) -> None:
    task, start, seed = drawn
    points = motions(task, start, seed)
    for scale in (0.0, 1.0, 100.0):
        costs = task.cost(scale * points)
        assert costs.shape == (len(points),)
        assert np.isfinite(costs).all(), seed


def test_a_cost_does_not_depend_on_the_rest_of_the_batch(drawn):
    task, start, seed = drawn
    points = motions(task, start, seed)
    together = task.cost(points)
    parts = np.concatenate([task.cost(points[:2]), task.cost(points[2:])])
    np.testing.assert_allclose(parts, together, rtol=1e-12, err_msg=str(seed))


def test_a_cost_is_the_sum_of_its_terms(drawn: tuple[Task, np.ndarray, int]) -> None:
    task, start, seed = drawn
    points = motions(task, start, seed)
    parts = [dataclasses.replace(task, costs=(term,)).cost(points) for term in task.costs]
    np.testing.assert_allclose(sum(parts), task.cost(points), err_msg=str(seed))


def test_it_costs_less_to_be_at_the_goal_than_at_the_start(drawn):
    task, start, seed = drawn
    there = motions(task, start, seed)[:1]
    stay = np.broadcast_to(start, there.shape)
    assert task.cost(there) < task.cost(stay), seed
    assert (task.to_goal(task.place(there)) <= 1e-6).all(), seed
