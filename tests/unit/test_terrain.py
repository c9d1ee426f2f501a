"""Ground that is not flat, as a surface and as what a robot stands on."""

import pickle

import mujoco
import numpy as np
import pytest

from flywheel.dynamics.plant import Plant, with_effects
from flywheel.dynamics.plant.world import scene
from flywheel.effects import EFFECTS, Scales, Term
from flywheel.errors import DataError, ModelError
from flywheel.records import State
from flywheel.robots import Robot, load_robot, read_robot
from flywheel.terrain import BRINK, Terrain
from tests import draws
from tests.physics.small_robots import hanging


@pytest.fixture
def seed() -> int:
    return draws.seed()


def rough(rng: np.random.Generator, shape: tuple[int, int] = (9, 13)) -> Terrain:
    origin = (float(rng.uniform(-9, 9)), float(rng.uniform(-9, 9)))
    return Terrain(rng.uniform(-0.4, 0.6, shape), float(rng.uniform(0.2, 0.9)), origin)


def gentle(height: float = 0.25) -> Terrain:
    """Hills about as long as the robot, all around it."""
    x = np.arange(-10, 10.01, 0.2)
    heights = height * np.cos(2.1 * x[:, None] + 0.3) * np.sin(1.7 * x[None] + 1.0)
    return Terrain(heights, 0.2, (-10.0, -10.0))


def raised(plant: Plant, height: float) -> State:
    rest = plant.rest()
    poses = rest.qpos.reshape(-1, 7).copy()
    poses[:, 2] += height
    return State(poses.reshape(1, -1), rest.qvel, rest.act)


def test_the_surface_is_where_mujoco_has_it(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    terrain = rough(rng)
    model = scene(robot, (), terrain).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ground = [model.geom("terrain").id, model.geom("ground").id]
    places = terrain.origin + rng.uniform(-0.2, 1.2, (300, 2)) * terrain.size
    heights, normals = terrain.at(places)
    seen, geom, normal = 0, np.zeros(1, np.int32), np.zeros(3)
    for (x, y), height, expected in zip(places, heights, normals, strict=True):
        above, down = np.array([x, y, 50.0]), np.array([0.0, 0.0, -1.0])
        found = mujoco.mj_ray(model, data, above, down, None, 1, -1, geom, normal)
        if geom[0] in ground:  # the robot stands in the way of some
            seen += 1
            assert 50.0 - found == pytest.approx(height, abs=1e-5), seed
            np.testing.assert_allclose(normal, expected, atol=1e-4, err_msg=str(seed))
    assert seen > 150


def test_around_it_lies_a_plane_below_all_of_it(seed: int) -> None:
    terrain = rough(np.random.default_rng(seed))
    outside = np.array(terrain.origin) - [[0.01, 1.0], [5.0, -1.0]]
    heights, normals = terrain.at(outside)
    assert (heights == terrain.heights.min() - BRINK).all()
    assert (normals == [0.0, 0.0, 1.0]).all()


def test_the_highest_ground_of_a_place_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    terrain = rough(rng)
    low = terrain.origin + rng.uniform(-0.2, 0.9, 2) * terrain.size
    high = low + rng.uniform(0.1, 3.0, 2)
    within = rng.uniform(low, high, (4000, 2))
    assert terrain.at(within)[0].max() <= terrain.highest(low, high) + 1e-12, seed
    assert terrain.highest(low, high) <= terrain.heights.max()


def test_equal_numbers_are_equal_terrains(seed: int) -> None:
    one, other = (rough(np.random.default_rng(seed)) for _ in range(2))
    assert one == other and hash(one) == hash(other) and one is not other
    assert one != Terrain(one.heights + 1e-9, one.cell, one.origin)
    assert one != Terrain(one.heights, one.cell, (one.origin[0] + 0.1, one.origin[1]))


@pytest.mark.parametrize(
    ("heights", "cell", "message"),
    [
        (np.zeros((1, 5)), 1.0, "at least 2 x 2"),
        (np.zeros(5), 1.0, "at least 2 x 2"),
        (np.array([[0.0, np.nan], [0.0, 0.0]]), 1.0, "finite"),
        (np.zeros((3, 3)), 0.0, "positive size"),
    ],
)
def test_what_is_no_terrain_is_refused(heights: np.ndarray, cell: float, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Terrain(heights, cell, (0.0, 0.0))


def test_a_robot_without_a_ground_cannot_stand_on_one() -> None:
    floating = read_robot(hanging().xml.replace('<geom type="plane" size="9 9 .1"/>', ""))
    with pytest.raises(ModelError, match="level ground plane"):
        Plant(floating, terrain=gentle())


@pytest.mark.parametrize("name", ["prism3", "icosa6"])
def test_a_robot_comes_to_rest_on_it(name: str) -> None:
    robot, terrain = load_robot(name), gentle()
    plant = Plant(robot, terrain=terrain)
    lying = plant.settle(6.0, start=raised(plant, 0.5))
    points = plant.observe(lying).points[0]
    heights, normals = terrain.at(points[:, :2])
    radii = np.array([point.radius for point in robot.points])
    gaps = (points[:, 2] - heights) * normals[:, 2] - radii
    assert gaps.min() > -0.05  # a cap in a hollow touches it beside the place below its centre
    assert np.sort(gaps)[0] < 0.05 and np.sort(gaps)[2] < 0.3  # motors are thicker than caps
    assert np.ptp(heights[np.argsort(gaps)[:3]]) > 0.01  # it would not lie like this on a plane


def test_a_flat_terrain_is_the_plane(robot: Robot, seed: int) -> None:
    flat = Terrain(np.zeros((41, 41)), 0.5, (-10.0, -10.0))
    rng = np.random.default_rng(seed)
    controls = np.repeat(rng.uniform(-0.3, 0.3, (1, 4, 6)), 10, axis=1)
    there = [
        plant.simulate(plant.settle(2.0), controls).observations.points
        for plant in (Plant(robot), Plant(robot, terrain=flat))
    ]
    assert np.abs(there[0] - there[1]).max() < 0.02 * robot.length


def test_a_plant_is_the_same_on_its_own_ground_and_another_one_elsewhere(robot: Robot) -> None:
    friction = EFFECTS["cable_friction"]
    values = tuple(p.typical(Scales.of(robot)) for p in friction.parameters)
    for plant in (Plant(robot), with_effects(Plant(robot), (Term(friction, None, values),))):
        assert plant.on(None) is plant
        there = plant.on(gentle())
        assert there.terrain == gentle() and there.terms == plant.terms
        copy = pickle.loads(pickle.dumps(there))
        start = raised(there, 0.5)
        controls = np.zeros((1, 80, 6))
        moved = [p.simulate(start, controls).observations.points for p in (there, copy)]
        np.testing.assert_array_equal(*moved)
        assert np.abs(moved[0] - plant.simulate(start, controls).observations.points).max() > 0
