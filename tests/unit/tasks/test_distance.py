import heapq

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flywheel.errors import ConfigError
from flywheel.robots import Box
from flywheel.tasks.distance import StraightLine, grid_around, in_the_way, near_boxes, shortest_ways
from tests import draws


def brute_force(free: np.ndarray, start: tuple[int, int], moves: str) -> np.ndarray:
    """Dijkstra with a heap, one corner at a time."""
    steps = [(1, 0), (-1, 0), (0, 1), (0, -1)]
    if moves == "diagonal":
        steps += [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    found = np.full(free.shape, np.inf)
    found[start] = 0.0
    queue = [(0.0, start)]
    while queue:
        length, (x, y) = heapq.heappop(queue)
        if length > found[x, y]:
            continue
        for dx, dy in steps:
            there = (x + dx, y + dy)
            if not all(0 <= c < n for c, n in zip(there, free.shape, strict=True)):
                continue
            if not (free[there] and free[x + dx, y] and free[x, y + dy]):
                continue
            longer = length + np.hypot(dx, dy)
            if longer < found[there] - 1e-12:
                found[there] = longer
                heapq.heappush(queue, (longer, there))
    return found


@pytest.mark.parametrize("moves", ["diagonal", "manhattan"])
def test_shortest_ways_are_those_of_brute_force(moves: str) -> None:
    seed = draws.seed()
    rng = np.random.default_rng(seed)
    free = rng.random((13, 9)) > 0.3
    start = (int(rng.integers(13)), int(rng.integers(9)))
    free[start] = True
    expected = brute_force(free, start, moves)
    got = shortest_ways(free, start, moves)  # type: ignore[arg-type]
    np.testing.assert_allclose(got, expected, rtol=1e-12, err_msg=f"seed {seed}")


def test_without_boxes_manhattan_ways_are_exactly_the_sum_of_both_axes() -> None:
    rng = np.random.default_rng(seed := draws.seed())
    goal = rng.uniform(-3, 3, 2)
    grid = grid_around(
        goal, (), low=goal - 5, high=goal + 5, cell=0.37, clearance=0.0, moves="manhattan"
    )
    # within one quadrant of the goal |x| + |y| is linear, so bilinear look-up is exact
    places = goal + rng.uniform(0.4, 4.5, (50, 2)) * rng.choice([-1, 1], (50, 2))
    expected = np.abs(places - goal).sum(axis=1)
    np.testing.assert_allclose(grid(places), expected, rtol=1e-9, err_msg=f"seed {seed}")


def test_diagonal_ways_are_at_most_a_twelfth_longer_than_the_straight_line() -> None:
    goal = np.array([0.3, -0.2])
    grid = grid_around(goal, (), low=goal - 4, high=goal + 4, cell=0.1, clearance=0.0)
    places = np.random.default_rng(0).uniform(-3, 3, (200, 2))
    straight = StraightLine(goal)(places)
    assert (grid(places) >= straight - 1e-9).all()
    assert (grid(places) <= straight * 1.083 + 0.05).all()
    assert grid(goal) == 0.0


def test_a_wall_makes_the_way_longer_by_the_detour() -> None:
    wall = Box(center=(0.0, 0.0, 1.0), half_size=(0.25, 2.0, 1.0))
    goal, place = np.array([2.0, 0.0]), np.array([-2.0, 0.0])
    corners = {"low": np.array([-4.0, -4.0]), "high": np.array([4.0, 4.0])}
    grid = grid_around(goal, [wall], **corners, cell=0.05, clearance=0.25)
    # over the wall's corners: 2 up and 1.5 along, on the grid's eight directions, and 1 across
    expected = 2 * np.hypot(1.5, 1.5) + 2 * (2.25 - 1.5) + 1.0
    assert grid(place) == pytest.approx(expected, abs=0.25)
    assert grid(place) > StraightLine(goal)(place) + 1.5


def test_a_place_inside_a_box_is_led_out_of_it() -> None:
    box = Box(center=(0.0, 0.0, 1.0), half_size=(1.0, 1.0, 1.0))
    goal = np.array([4.0, 0.0])
    grid = grid_around(
        goal, [box], low=np.full(2, -5.0), high=np.full(2, 5.0), cell=0.1, clearance=0.2
    )
    inside = grid(np.stack([np.linspace(0.3, 1.1, 9), np.zeros(9)], axis=1))
    assert np.isfinite(inside).all()
    assert (np.diff(inside) < 0).all()


def test_beyond_the_grid_the_way_to_it_counts_on_top() -> None:
    goal = np.zeros(2)
    grid = grid_around(goal, (), low=np.full(2, -1.0), high=np.full(2, 1.0), cell=0.1, clearance=0)
    edge, beyond = np.array([1.0, 0.0]), np.array([4.0, 0.0])
    assert grid(beyond) == pytest.approx(grid(edge) + 3.0)


def test_a_goal_in_a_box_is_refused_with_its_place() -> None:
    box = Box(center=(1.0, 2.0, 1.0), half_size=(0.5, 0.5, 1.0))
    with pytest.raises(ConfigError, match=r"goal \(1, 2\) lies in an obstacle"):
        grid_around(
            np.array([1.0, 2.0]),
            [box],
            low=np.zeros(2),
            high=np.full(2, 4.0),
            cell=0.1,
            clearance=0.1,
        )


def test_an_enclosed_place_reaches_nothing_but_has_a_finite_distance() -> None:
    walls = [
        Box(center=(x, y, 1), half_size=(hx, hy, 1))
        for x, y, hx, hy in (
            (1, 0, 0.1, 1.1),
            (-1, 0, 0.1, 1.1),
            (0, 1, 1.1, 0.1),
            (0, -1, 1.1, 0.1),
        )
    ]
    goal = np.array([3.0, 0.0])
    grid = grid_around(
        goal, walls, low=np.full(2, -4.0), high=np.full(2, 4.0), cell=0.1, clearance=0.1
    )
    assert not grid.reaches(np.zeros(2))
    assert grid.reaches(np.array([-3.0, 0.0]))
    assert np.isfinite(grid(np.zeros(2)))
    places = np.array([[-3.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.11, 0.0], [1.31, 0.0], [99.0, 0.0]])
    np.testing.assert_allclose(grid.astray(places), [0.0, 1.2, 0.2, 0.1, 0.0, 0.0], atol=1e-9)
    assert not StraightLine(goal).astray(places).any()


def test_paths_lead_around_turned_walls_over_ramps_and_under_ceilings() -> None:
    def box(height: float, axis: str, degrees: float) -> Box:
        turned = Rotation.from_euler(axis, degrees, degrees=True).as_quat(scalar_first=True)
        return Box(center=(0, 0, height), half_size=(4, 0.2, 0.5), quaternion=tuple(turned))

    wall, ramp, ceiling = box(0.5, "z", 45.0), box(0.0, "y", 20.0), box(3.0, "z", 0.0)
    assert in_the_way([wall, ramp, ceiling], headroom=2.0) == [wall]
    assert in_the_way([wall, ramp, ceiling], headroom=2.6) == [wall, ceiling]
    on_its_side = box(0.5, "x", 90.0)
    assert not on_its_side.tilted
    places = np.array([[2.0, 2.0], [2.0, -2.0], [3.0, 3.2], [0.0, 0.45], [0.0, 0.55]])
    assert near_boxes(places, [wall], 0.0).tolist() == [True, False, False, False, False]
    assert near_boxes(places, [on_its_side], 0.0).tolist() == [False, False, False, True, False]


def test_near_boxes_rounds_the_corners() -> None:
    box = Box(center=(0, 0, 0), half_size=(1, 1, 1))
    places = np.array([[1.5, 0.0], [1.4, 1.4], [1.3, 1.3], [0.0, 0.0]])
    assert near_boxes(places, [box], 0.5).tolist() == [True, False, True, True]
