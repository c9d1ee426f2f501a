import heapq

import numpy as np
import pytest

from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError
from flywheel.robots import Box, load_robot
from flywheel.tasks import Stand, TaskConfig, sample_task
from flywheel.tasks.distance import grid_around
from flywheel.tasks.rolling import HEADINGS, ROLLS, axis_of, rolling_ways, shortest_rolls
from tests import draws


@pytest.fixture(scope="module")
def prism() -> np.ndarray:
    """Caps of prism3 at rest; its rods lead from one end to the other."""
    plant = Plant(load_robot("prism3"))
    return plant.observe(plant.rest()).points[0]


def brute_force(free: np.ndarray, start: tuple[int, int], turn: float, aside: float) -> np.ndarray:
    """Dijkstra with a heap, one pose at a time."""
    found = np.full((len(ROLLS), *free.shape), np.inf)
    queue = [(0.0, k, *start) for k in range(len(ROLLS))]
    angles = [*HEADINGS, np.pi]
    while queue:
        length, k, x, y = heapq.heappop(queue)
        if length >= found[k, x, y]:
            continue
        found[k, x, y] = length
        for other, angle in (
            ((k + 1) % len(ROLLS), angles[k + 1] - angles[k]),
            (
                k - 1 if k else len(ROLLS) - 1,
                (angles[k] - angles[k - 1]) if k else np.pi - angles[-2],
            ),
        ):
            heapq.heappush(queue, (length + turn * angle, other, x, y))
        a, b = ROLLS[k]
        for sign in (1, -1):
            for (dx, dy), factor in (((sign * a, sign * b), 1.0), ((-sign * b, sign * a), aside)):
                xs = range(min(x, x + dx), max(x, x + dx) + 1)
                ys = range(min(y, y + dy), max(y, y + dy) + 1)
                inside = min(xs) >= 0 <= min(ys) and max(xs) < len(free) and max(ys) < free.shape[1]
                if inside and all(free[i, j] for i in xs for j in ys):
                    step = factor * np.hypot(dx, dy)
                    heapq.heappush(queue, (length + step, k, x + dx, y + dy))
    return found


def test_shortest_rolls_are_those_of_brute_force() -> None:
    seed = draws.seed()
    rng = np.random.default_rng(seed)
    free = rng.random((11, 8)) > 0.15
    start = (int(rng.integers(11)), int(rng.integers(8)))
    free[start] = True
    turn, aside = rng.uniform(0.5, 6), rng.uniform(1, 4)
    got = shortest_rolls(free, start, turn, aside)
    expected = brute_force(free, start, turn, aside)
    np.testing.assert_allclose(got, np.where(free, expected, np.inf), err_msg=f"seed {seed}")


def test_the_axis_of_a_prism_leads_from_one_end_to_the_other(prism: np.ndarray) -> None:
    axis = axis_of(prism)
    assert (np.sign(axis[::2]) == -np.sign(axis[1::2])).all()
    assert abs(axis.sum()) < 1e-9  # the same wherever the robot is
    assert np.abs(axis) == pytest.approx(np.full(6, 1 / 6), rel=0.1)


def ways(prism: np.ndarray, goal: tuple[float, float], boxes: tuple[Box, ...] = ()):
    grid = grid_around(
        np.array(goal),
        boxes,
        low=np.full(2, -12.0),
        high=np.full(2, 12.0),
        cell=0.25,
        clearance=0.5,
    )
    return rolling_ways(grid, prism, 4.0, 3.0)


def facing(prism: np.ndarray, place: tuple[float, float], heading: float) -> np.ndarray:
    """Caps of the robot at a place, rolling in a direction [rad]."""
    axis = axis_of(prism) @ prism
    weights = np.full(6, 1 / 6)
    turn = heading - np.arctan2(axis[0], -axis[1])
    return Stand(np.array(place), turn).points(prism, weights)


@pytest.mark.parametrize("half_turns", [0, 1])
def test_a_robot_that_rolls_towards_the_goal_has_the_straight_distance_left(prism, half_turns):
    far = ways(prism, (6.0, 0.0))
    here = np.array([-2.0, 0.0])
    straight = far(facing(prism, (-2, 0), half_turns * np.pi), here)
    assert straight == pytest.approx(8.0)
    # a robot that lies along its way turns by a right angle: as far as rolling for 4 m / rad
    along = far(facing(prism, (-2, 0), np.pi / 2 + half_turns * np.pi), here)
    assert along == pytest.approx(8.0 + 4.0 * np.pi / 2)


def test_near_the_goal_moving_along_the_axis_is_shorter_than_turning(prism: np.ndarray) -> None:
    far = ways(prism, (0.0, 0.0))
    here = np.array([0.0, -1.0])
    assert far(facing(prism, (0, -1), 0.0), here) == pytest.approx(3.0)  # aside by 1 m, three times


def test_between_two_directions_the_distance_is_interpolated(prism: np.ndarray) -> None:
    far = ways(prism, (6.0, 0.0))
    here, between = np.array([-2.0, 0.0]), HEADINGS[-1] + 0.25 * (np.pi - HEADINGS[-1])
    ends = [far(facing(prism, (-2, 0), h), here) for h in (HEADINGS[-1], np.pi)]
    got = far(facing(prism, (-2, 0), between), here)
    assert got == pytest.approx(0.75 * ends[0] + 0.25 * ends[1])


def test_before_a_wall_it_is_better_to_lie_so_that_the_robot_rolls_around_it(prism) -> None:
    wall = Box(center=(2.0, 4.0, 1.0), half_size=(0.25, 6.0, 1.0))
    far = ways(prism, (6.0, 3.0), (wall,))
    here = np.array([1.0, 3.0])
    at_it = far(facing(prism, (1, 3), 0.0), here)
    past_it = far(facing(prism, (1, 3), np.pi / 2), here)
    assert past_it < at_it - 1.0


def test_each_goal_of_a_tour_counts_turns(prism: np.ndarray) -> None:
    robot = load_robot("prism3")
    config = TaskConfig(stops=2, turn=1.4)
    task = sample_task("tour", robot, prism, np.random.default_rng(0), config)
    plain = sample_task("tour", robot, prism, np.random.default_rng(0), TaskConfig(stops=2))
    while task is not None and plain is not None:
        left = task.way_left(prism[None])
        assert left >= plain.way_left(prism[None]) - 1e-9
        assert (task.goal == plain.goal).all()
        task, plain = task.then, plain.then
    assert task is plain is None


def test_a_robot_without_a_level_axis_is_refused() -> None:
    plant = Plant(robot := load_robot("icosa6"))
    start = plant.observe(plant.rest()).points[0]
    with pytest.raises(ConfigError, match=r"task\.turn is for robots that roll"):
        sample_task("reach", robot, start, np.random.default_rng(0), TaskConfig(turn=1.0))
