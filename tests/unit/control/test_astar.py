"""A search over cycles of gaits: on made motions with known answers, and on the plant."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.control import AStar, EpisodeOrder, astar, record_episode
from flywheel.control.astar import Cycles, fastest
from flywheel.dynamics.plant import MeasurementModel, Plant, PlantDynamics
from flywheel.errors import ConfigError
from flywheel.records import Provenance
from flywheel.robots import Box, Robot, load_robot
from flywheel.tasks import StraightLine, Task, TaskConfig, grid_around, sample_task
from flywheel.tasks.distance import near_boxes

GOES = np.stack([np.linspace(0.25, 1.0, 4), np.zeros(4)], axis=1)
# One metre ahead in 2 s, and a quarter turn on the spot in 3 s.
MADE = Cycles(
    gaits=("roll", "cw", "ccw"),
    paths=np.stack([[GOES, 0 * GOES, 0 * GOES]] * 2),
    turns=np.array([[0.0, -np.pi / 2, np.pi / 2]] * 2),
    seconds=np.array([[2.0, 3.0, 3.0]] * 2),
)
WALL = Box(center=(3.0, -1.0, 1.0), half_size=(0.5, 2.0, 1.0))
CLEARANCE = 0.5


def going(robot: Robot, goal: tuple[float, float], *walls: Box) -> Task:
    there, far = np.array(goal), np.full(2, 9.0)
    ways = grid_around(there, walls, low=-far, high=far, cell=0.25, clearance=CLEARANCE)
    to_goal = ways if walls else StraightLine(there)
    return Task("made", robot, there, 0.35, 60.0, to_goal, obstacles=walls)


@pytest.mark.parametrize(
    ("goal", "gaits", "seconds"),
    [
        ((3, 0), ["roll"] * 3, 6.0),
        ((2, 1), ["roll", "roll", "ccw", "roll"], 9.0),
        ((2, -1), ["roll", "roll", "cw", "roll"], 9.0),
        ((0, 2), ["ccw", "roll", "roll"], 7.0),
        ((-1, 0), None, 8.0),  # two turns of either kind
    ],
)
def test_the_sequence_is_the_fastest_one(robot: Robot, goal, gaits, seconds) -> None:
    found = fastest(going(robot, goal), MADE, np.zeros(3))
    assert found.arrives
    assert found.cost == seconds
    if gaits is not None:
        assert [step.gait for step in found.sequence[1:]] == gaits


def test_a_wall_is_gone_around_at_its_shorter_end_and_no_nearer_than_the_clearance(robot) -> None:
    """Two metres up, six along and two down, with three turns; below it would be eight more metres."""
    task = going(robot, (6, 0), WALL)
    found = fastest(task, MADE, np.zeros(3))
    path = np.concatenate([step.path for step in found.sequence])
    assert found.arrives
    assert found.cost == 10 * 2.0 + 3 * 3.0
    assert not near_boxes(path, [WALL], CLEARANCE).any()
    assert path[:, 1].max() == pytest.approx(2.0)


def test_a_robot_beside_a_wall_leaves_it_and_one_that_can_only_go_through_it_still_has_a_plan(
    robot,
):
    task = going(robot, (6, 0), WALL)
    leaves = fastest(task, MADE, np.array([3.0, 1.3, 0.0]))
    assert leaves.cost == 4 * 2.0 + 3.0
    only = Cycles(MADE.gaits[:1], MADE.paths[:, :1], MADE.turns[:, :1], MADE.seconds[:, :1])
    through = fastest(task, only, np.zeros(3))
    assert through.arrives
    assert through.cost > 6 * 2.0 + astar.ASTRAY


def test_a_cycle_from_rest_is_another_motion_than_one_that_goes_on(robot: Robot) -> None:
    slow = replace(MADE, seconds=MADE.seconds + [[4.0] * 3, [0.0] * 3])
    task = going(robot, (3, 0))
    assert fastest(task, slow, np.zeros(3)).cost == 10.0
    assert fastest(task, slow, np.zeros(3), "cw").cost == 10.0
    assert fastest(task, slow, np.zeros(3), "roll").cost == 6.0


def test_a_search_that_takes_too_long_gives_the_sequence_that_comes_nearest(
    robot, monkeypatch
) -> None:
    monkeypatch.setattr(astar, "EXPANSIONS", 4)
    monkeypatch.setattr(astar, "BATCH", 1)
    found = fastest(going(robot, (8, 0)), MADE, np.zeros(3))
    assert not found.arrives
    assert {step.gait for step in found.sequence[1:]} == {"roll"}


def test_a_way_that_takes_too_long_to_find_is_searched_with_more_greed(robot, monkeypatch) -> None:
    """With fewer poses, a later search is the first one to arrive, by a slower sequence."""
    monkeypatch.setattr(astar, "BATCH", 1)
    task, costs = going(robot, (-6, 6)), []
    for poses in (400, 100, 50):
        monkeypatch.setattr(astar, "EXPANSIONS", poses)
        found = fastest(task, MADE, np.zeros(3))
        assert found.arrives
        costs.append(found.cost)
    assert costs == [30.0, 33.0, 36.0]


@pytest.fixture(scope="module")
def cycles(robot: Robot) -> Cycles:
    return Cycles.measured(Plant(robot))


@pytest.mark.slow
def test_a_goal_beside_the_robot_is_reached_on_the_plant(robot: Robot, cycles, monkeypatch) -> None:
    monkeypatch.setattr(Cycles, "measured", lambda plant: cycles)
    plant = Plant(robot)
    planner = AStar(PlantDynamics(plant))
    start = plant.settle(1.0)
    config = TaskConfig(goal=(-2.1, 3.2), seconds=60.0)
    points = plant.observe(start).points[0]
    task = sample_task("reach", robot, points, np.random.default_rng(0), config)
    episode = record_episode(
        plant,
        MeasurementModel(noise=0.005),
        planner,
        task,
        EpisodeOrder("one", Provenance(robot.digest), seconds=60.0, seed=1),
        start=start,
    )
    assert episode.outcome.success
    planned = episode.telemetry["plan_seconds"] > 0
    assert planned.sum() == len(episode.plans.begins) > 1
    last = episode.plans.at(episode.outcome.seconds)[0]
    assert np.linalg.norm(last - task.goal, axis=1).min() < 2 * task.tolerance


@pytest.mark.slow
def test_cycles_are_measured_as_published(cycles: Cycles) -> None:
    """Two cycles of each, as in tests/physics/test_gaits.py, where the robot comes to rest after them."""
    assert cycles.gaits == ("roll", "cw", "ccw", "roll_back", "cw_back", "ccw_back")
    assert np.linalg.norm(cycles.paths[:, 0, -1], axis=1).sum() == pytest.approx(3.82, rel=0.1)
    assert np.degrees(cycles.turns[:, 1].sum()) == pytest.approx(-61.0, rel=0.1)
    np.testing.assert_allclose(cycles.seconds[:, :3].sum(axis=0), [9.0, 13.6, 11.4], rtol=0.15)


@pytest.mark.slow
def test_backwards_the_robot_goes_the_other_way_and_turns_the_same_way(cycles: Cycles) -> None:
    """Seen from its other end it is the same robot; measured after the first cycle, within its scatter."""
    ahead, back = cycles.paths[1, :3, -1, 1], cycles.paths[1, 3:, -1, 1]
    np.testing.assert_allclose(back, -ahead, atol=0.15)
    np.testing.assert_allclose(cycles.turns[1, 3:], cycles.turns[1, :3], atol=np.radians(4))


def test_it_needs_a_task_and_a_robot_with_gaits(robot: Robot) -> None:
    with pytest.raises(ConfigError, match="needs a task"):
        AStar(PlantDynamics(Plant(robot))).act(None)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="gaits are for prism3.*icosa6 has others"):
        AStar(PlantDynamics(Plant(load_robot("icosa6"))))
