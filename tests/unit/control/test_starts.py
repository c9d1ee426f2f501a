"""Where episodes begin is rigid motion: centres, distances and turns say so."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flywheel.control import above_ground, by_a_box, perturbed, random_drop, standing, thrown
from flywheel.control.starts import HEIGHT, TILT
from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError, RobotError
from flywheel.records import State
from flywheel.robots import Robot, load_robot
from flywheel.terrain import LEVEL, Box, Terrain, with_boxes

PLACE, TURN = np.array([3.0, -2.0]), 0.7


@pytest.fixture(scope="module")
def plant(robot: Robot) -> Plant:
    """Of a robot whose rods do not weigh the same."""
    plant = Plant(robot)
    masses = [body.mass * factor for body, factor in zip(robot.bodies, (1, 2, 4), strict=True)]
    bodies = tuple(replace(b, mass=m) for b, m in zip(robot.bodies, masses, strict=True))
    plant.robot = replace(robot, bodies=bodies)
    return plant


@pytest.fixture(scope="module")
def lying(plant: Plant) -> State:
    """The robot somewhere, turned somehow, and moving."""
    drop = random_drop(plant, np.random.default_rng(1), 1)
    return replace(drop, qvel=np.ones_like(drop.qvel))


def center(plant: Plant, state: State) -> np.ndarray:
    """(n, 3) centres of mass."""
    pose = state.qpos.reshape(len(state.qpos), -1, 7)
    masses = np.array([body.mass for body in plant.robot.bodies])
    return np.einsum("b,nbi->ni", masses / masses.sum(), pose[..., :3])


def test_a_robot_stands_where_it_is_put_and_turned_as_asked(plant: Plant, lying: State) -> None:
    put = standing(plant, lying, PLACE, TURN)
    before, after = plant.observe(lying).points[0], plant.observe(put).points[0]
    was, now = center(plant, lying)[0], center(plant, put)[0]
    np.testing.assert_allclose(now, [*PLACE, was[2]], atol=1e-12)
    turned = Rotation.from_euler("z", TURN).apply(before - was)
    np.testing.assert_allclose(after - now, turned, atol=1e-9)
    assert not put.qvel.any()
    np.testing.assert_array_equal(put.act, lying.act)
    assert put.qpos.shape == lying.qpos.shape


def test_a_robot_carried_back_is_where_it_was(plant: Plant, lying: State) -> None:
    away = standing(plant, lying, PLACE, TURN)
    back = standing(plant, away, center(plant, lying)[0, :2], -TURN)
    np.testing.assert_allclose(plant.observe(back).points, plant.observe(lying).points, atol=1e-9)


def test_drops_turn_about_the_robots_own_centre_which_stays_above_its_place(plant: Plant) -> None:
    drops = random_drop(plant, np.random.default_rng(2), 20)
    here = center(plant, plant.rest())[0, :2]
    np.testing.assert_allclose(center(plant, drops)[:, :2], np.tile(here, (20, 1)), atol=1e-9)


def test_drops_fall_from_all_heights_between_the_bounds(plant: Plant) -> None:
    drops = random_drop(plant, np.random.default_rng(3), 400)
    radius = plant.robot.points[0].radius
    lowest = (plant.observe(drops).points[..., 2] - radius).min(axis=1) / plant.robot.length
    low, high = HEIGHT
    assert low <= lowest.min() < low + 0.02 and high - 0.02 < lowest.max() <= high
    assert lowest.mean() == pytest.approx((low + high) / 2, abs=0.02)


def test_drops_are_turned_any_way_alike(plant: Plant) -> None:
    """A direction that is fixed in the robot points anywhere on the sphere: mean 0, and a third each."""
    points = plant.observe(random_drop(plant, np.random.default_rng(4), 4000)).points
    along = points[:, 1] - points[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    np.testing.assert_allclose(along.mean(axis=0), 0.0, atol=0.04)
    np.testing.assert_allclose(along.T @ along / 4000, np.eye(3) / 3, atol=0.03)


def test_a_perturbed_robot_is_a_tilted_keyframe_just_above_the_ground(plant: Plant) -> None:
    """Tilted by any angle up to the largest, in any direction, with any heading."""
    begun = perturbed(plant, np.random.default_rng(5), 2000)
    points, own = plant.observe(begun).points, plant.observe(plant.rest()).points[0]
    turns = Rotation.concatenate(
        [Rotation.align_vectors(p - p.mean(axis=0), own - own.mean(axis=0))[0] for p in points]
    )
    tilted = np.arccos(turns.as_matrix()[:, 2, 2])
    assert tilted.max() <= TILT + 1e-9 and tilted.mean() == pytest.approx(TILT / 2, rel=0.05)
    directions = np.exp(1j * turns.as_euler("ZXZ")[:, [0, 2]])  # of the tilt, and of the robot
    assert np.abs(directions.mean(axis=0)).max() < 0.06
    shape = [
        np.linalg.norm(p[..., :, None, :] - p[..., None, :, :], axis=-1) for p in (points, own)
    ]
    np.testing.assert_allclose(shape[0], np.broadcast_to(shape[1], shape[0].shape), atol=1e-9)
    radius = plant.robot.points[0].radius
    lowest = (points[..., 2] - radius).min(axis=1) / plant.robot.length
    np.testing.assert_allclose(lowest, HEIGHT[0])
    assert not begun.qvel.any()


@dataclass
class Ground:
    """Ground of which it is asked how high it is; it remembers where."""

    heights = np.ones((2, 2))

    def __post_init__(self) -> None:
        self.asked: list[np.ndarray] = []

    def highest(self, low: np.ndarray, high: np.ndarray) -> float:
        self.asked.append(np.stack([low, high]))
        return 0.5 * len(self.asked)


def test_each_robot_is_lifted_by_the_highest_ground_below_its_caps(plant: Plant) -> None:
    ground, states = Ground(), random_drop(plant, np.random.default_rng(5), 3)
    over = SimpleNamespace(robot=plant.robot, observe=plant.observe, terrain=ground)
    lifted = above_ground(over, states)  # type: ignore[arg-type]
    before, after = plant.observe(states).points, plant.observe(lifted).points
    np.testing.assert_allclose(
        after - before, np.multiply.outer([0.5, 1.0, 1.5], np.tile([0, 0, 1], (6, 1))), atol=1e-9
    )
    radius = plant.robot.points[0].radius
    for points, (low, high) in zip(before, ground.asked, strict=True):
        np.testing.assert_allclose(low, points[:, :2].min(axis=0) - radius)
        np.testing.assert_allclose(high, points[:, :2].max(axis=0) + radius)
    np.testing.assert_array_equal(lifted.qvel, states.qvel)


def test_on_the_plane_nothing_is_lifted(plant: Plant, lying: State) -> None:
    assert above_ground(plant, lying) is lying


def test_a_drop_over_a_hill_is_as_high_above_it_as_one_over_the_plane(robot, plant):
    hill = Terrain(np.full((4, 4), 0.8), 10.0, (-15.0, -15.0))
    flat = random_drop(Plant(robot), np.random.default_rng(6), 2)
    high = random_drop(Plant(robot, terrain=hill), np.random.default_rng(6), 2)
    rise = high.qpos.reshape(2, -1, 7) - flat.qpos.reshape(2, -1, 7)
    np.testing.assert_allclose(rise[..., 2], 0.8)
    assert not rise[..., [0, 1, 3, 4, 5, 6]].any()


def test_a_robot_with_other_joints_than_free_ones_is_not_carried(plant, lying):
    jointed = Plant(replace(plant.robot, free=False))
    with pytest.raises(RobotError, match="cannot be dropped or carried: it has joints"):
        standing(jointed, lying, PLACE, TURN)


def test_a_thrown_robot_flies_and_turns_as_a_whole(robot: Robot) -> None:
    plant, dt = Plant(robot), 1e-6
    start = thrown(plant, np.random.default_rng(2), 2)
    assert np.array_equal(start.qpos, random_drop(plant, np.random.default_rng(2), 2).qpos)
    pose = start.qpos.reshape(2, -1, 7).copy()
    speed = start.qvel.reshape(2, -1, 6)
    turn = Rotation.from_rotvec(dt * speed[..., 3:].reshape(-1, 3))  # about the body's own axes
    now = Rotation.from_quat(pose[..., 3:].reshape(-1, 4), scalar_first=True)
    pose[..., :3] += dt * speed[..., :3]
    pose[..., 3:] = (now * turn).as_quat(scalar_first=True).reshape(pose[..., 3:].shape)
    moved = replace(start, qpos=pose.reshape(2, -1))
    before, after = (plant.observe(state).points for state in (start, moved))
    apart = [np.linalg.norm(p[:, :, None] - p[:, None], axis=-1) for p in (before, after)]
    assert np.abs(after - before).max() > 1e-7
    assert np.allclose(*apart, rtol=0.0, atol=1e-10)


WALL = Box(center=(8.0, 0.0, 1.0), half_size=(0.3, 6.0, 1.0))
CEILING = Box(center=(-8.0, 0.0, 2.4), half_size=(3.0, 3.0, 0.1))
RAMP = Box(center=(0.0, 20.0, 0.0), half_size=(6.0, 6.0, 0.5), quaternion=(0.9962, 0, -0.0872, 0))


def test_a_robot_by_a_box_touches_none_and_is_near_one() -> None:
    """Beside, below or on it, turned in any direction; a thin wall does not cut through the robot."""
    boxes = WALL, CEILING, RAMP
    plant = Plant(load_robot("prism3")).on(with_boxes(None, boxes))
    model, rng, near, headings = plant.model, np.random.default_rng(2), set(), []
    data, lying = mujoco.MjData(model), plant.rest()
    for _ in range(60):
        put = by_a_box(plant, lying, rng)
        data.qpos[:] = put.qpos[0]
        mujoco.mj_forward(model, data)
        touching = {int(geom) for contact in data.contact for geom in contact.geom}
        assert not {g for g in touching if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_BOX}
        points = plant.observe(put).points[0]
        gaps = [np.linalg.norm(np.maximum(b.beyond(points), 0), axis=1).min() for b in boxes]
        assert min(gaps) < 1.5 * plant.robot.length
        near.add(int(np.argmin(gaps)))
        rods = points[::2] + np.linspace(0, 1, 300)[:, None, None] * (points[1::2] - points[::2])
        assert (WALL.beyond(rods).max(axis=-1) > 0.0).all()
        headings.append(np.arctan2(*(points[1, :2] - points[0, :2])))
    assert near == {0, 1, 2}
    assert np.ptp(headings) > 5.0


@pytest.mark.parametrize("terrain", [None, LEVEL])
def test_without_a_box_no_robot_is_by_one(terrain: Terrain | None) -> None:
    plant = Plant(load_robot("prism3")).on(terrain)
    with pytest.raises(ConfigError, match="prism3 could not be placed by one of 0 boxes"):
        by_a_box(plant, plant.rest(), np.random.default_rng(0))
