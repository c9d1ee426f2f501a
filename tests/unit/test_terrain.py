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
from flywheel.terrain import BRINK, Box, Terrain, is_level, with_boxes
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
    model = scene(robot, terrain).compile()
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


def turned_box(rng: np.random.Generator) -> Box:
    """A box near the origin, in any orientation."""
    quaternion = rng.standard_normal(4)
    return Box(
        center=tuple(rng.uniform(-1.0, 1.0, 3)),
        half_size=tuple(rng.uniform(0.2, 1.5, 3)),
        quaternion=tuple(quaternion / np.linalg.norm(quaternion)),
    )


def test_a_box_is_where_mujoco_has_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    box, ball = turned_box(rng), hanging()
    model = scene(ball, with_boxes(None, [box])).compile()
    data, bob, obstacle = mujoco.MjData(model), model.geom("bob").id, model.geom("obstacle0").id
    places, outside = rng.uniform(-4.0, 4.0, (60, 3)), 0
    assert box.beyond(box.corners) == pytest.approx(0.0, abs=1e-9)
    for place, beyond in zip(places, box.beyond(places), strict=True):
        data.qpos[:3] = place
        mujoco.mj_kinematics(model, data)
        apart = mujoco.mj_geomDistance(model, data, bob, obstacle, 100.0, np.zeros(6))
        if beyond.max() > 0:
            outside += 1
            wanted = np.linalg.norm(np.maximum(beyond, 0.0)) - model.geom_size[bob, 0]
            assert apart == pytest.approx(wanted, abs=1e-6), seed
    assert outside > 20


def test_boxes_far_away_change_nothing_on_the_plane(robot: Robot) -> None:
    wall = with_boxes(None, [Box(center=(50.0, 0.0, 1.0), half_size=(1.0, 9.0, 1.0))])
    assert wall is not None and is_level(wall) and wall.plane == 0.0
    assert wall.highest(np.zeros(2), np.ones(2)) == 0.0
    heights, normals = wall.at(np.ones((4, 2)))
    assert not heights.any() and (normals == [0.0, 0.0, 1.0]).all()
    controls = np.full((1, 30, 6), 0.1)
    plain, walled = (
        Plant(robot, terrain=terrain).simulate(Plant(robot).rest(), controls).observations.points
        for terrain in (None, wall)
    )
    np.testing.assert_array_equal(plain, walled)


def test_a_box_without_a_rotation_is_refused() -> None:
    with pytest.raises(ValueError, match="length of 1"):
        Box(center=(0, 0, 0), half_size=(1, 1, 1), quaternion=(0.5, 0.5, 0.0, 0.0))


def test_equal_numbers_are_equal_terrains(seed: int) -> None:
    one, other = (rough(np.random.default_rng(seed)) for _ in range(2))
    assert one == other and hash(one) == hash(other) and one is not other
    assert one != Terrain(one.heights + 1e-9, one.cell, one.origin)
    assert one != Terrain(one.heights, one.cell, (one.origin[0] + 0.1, one.origin[1]))
    box = turned_box(np.random.default_rng(seed))
    assert with_boxes(one, [box]) == with_boxes(other, [box]) != one
    assert with_boxes(with_boxes(one, [box]), [box]) == with_boxes(one, [box])
    assert with_boxes(one, []) is one and with_boxes(None, []) is None


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
