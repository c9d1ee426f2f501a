"""What holds for every shipped robot."""

import pickle

import mujoco
import numpy as np
import pytest

from flywheel.dynamics.plant import Plant, PlantDynamics
from flywheel.records import Past, State
from flywheel.robots import ROBOTS, Robot, load_robot, read_robot

DT = 0.01


@pytest.fixture(scope="module", params=sorted(ROBOTS))
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


@pytest.fixture(scope="module")
def plant(robot: Robot) -> Plant:
    return Plant(robot, DT)


def random_controls(robot: Robot, batch: int, steps: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    knots = rng.uniform(
        robot.control_low, robot.control_high, (batch, -(-steps // 20), len(robot.winches))
    )
    return np.repeat(knots, 20, axis=1)[:, :steps]


def test_it_stays_where_its_keyframe_puts_it(robot: Robot, plant: Plant) -> None:
    after = plant.settle(5.0)
    moved = np.abs(plant.observe(after).points - plant.observe(plant.rest()).points).max()
    assert moved < 1e-3 * robot.length
    assert np.abs(after.qvel).max() < 1e-3
    np.testing.assert_allclose(after.act[0], robot.keyframe.act, atol=1e-9)


def test_a_push_dies_away(robot: Robot, plant: Plant) -> None:
    start = plant.rest()
    kick = np.random.default_rng(5).normal(scale=0.05, size=start.qvel.shape)
    hold = np.repeat(robot.holding(plant.winch(start))[:, None], 4000, axis=1)
    speed = np.abs(plant.simulate(State(start.qpos, kick, start.act), hold).states.qvel).max(
        axis=-1
    )
    assert speed[0, -1] < 0.1 * speed[0, 0]


def test_most_cables_hold_it_up(robot: Robot) -> None:
    model = mujoco.MjModel.from_xml_string(robot.xml)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    tension = -data.actuator_force
    taut = tension > 1e-3 * model.body_mass.sum() * 9.81
    assert taut.mean() >= 0.5
    assert (tension >= 0).all()


def test_its_digest_ignores_layout_and_comments_but_no_number(robot: Robot) -> None:
    assert load_robot(robot.name).digest == robot.digest
    spaced = robot.xml.replace("><", ">\n\n<").replace("<worldbody>", "<worldbody><!-- here -->")
    assert read_robot(spaced).digest == robot.digest
    heavier = robot.xml.replace('timestep="0.005"', 'timestep="0.004"')
    assert read_robot(heavier).digest != robot.digest


def test_masses_and_centres_are_those_of_its_pieces(robot: Robot) -> None:
    for body in robot.bodies:
        masses = np.array([p.mass for p in body.primitives])
        offsets = np.array([p.offset for p in body.primitives])
        assert masses.sum() == pytest.approx(body.mass)
        np.testing.assert_allclose(masses @ offsets / masses.sum(), body.com, atol=1e-9)


def test_observations_are_the_kinematics_of_the_states(robot: Robot, plant: Plant) -> None:
    controls = random_controls(robot, 2, 60, seed=1)
    trajectory = plant.simulate(plant.rest(2), controls)
    model = mujoco.MjModel.from_xml_string(robot.xml)
    data = mujoco.MjData(model)
    sites = [int(model.sensor(p.name).objid[0]) for p in robot.points]
    for t in (0, 1, 33, 60):
        data.qpos[:] = trajectory.states.qpos[1, t]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_array_equal(
            trajectory.observations.points[1, t], data.site_xpos[sites], err_msg=f"step {t}"
        )
    again = plant.observe(trajectory.states).points
    np.testing.assert_array_equal(again, trajectory.observations.points)


def test_the_winches_do_what_dead_reckoning_says(robot: Robot, plant: Plant) -> None:
    controls = random_controls(robot, 3, 200, seed=2)
    winch = plant.simulate(plant.rest(3), controls).observations.winch
    reckoned = robot.dead_reckon(winch[:, 0], controls, DT)
    np.testing.assert_allclose(winch, reckoned, atol=1e-6)
    assert np.ptp(winch) > 0.1


def test_a_batch_may_be_split_and_threaded_anyhow(robot: Robot, plant: Plant) -> None:
    controls = random_controls(robot, 5, 50, seed=3)
    whole = plant.simulate(plant.rest(5), controls).states
    threaded = Plant(robot, DT, threads=2).simulate(plant.rest(5), controls).states
    for part in (slice(0, 2), slice(2, 5)):
        split = plant.simulate(plant.rest(1), controls[part]).states
        np.testing.assert_array_equal(split.qpos, whole.qpos[part])
    np.testing.assert_array_equal(threaded.qpos, whole.qpos)


def test_time_may_be_split_to_the_bit(robot: Robot, plant: Plant) -> None:
    controls = random_controls(robot, 2, 90, seed=4)
    whole = plant.simulate(plant.rest(2), controls).states
    first = plant.simulate(plant.rest(2), controls[:, :37]).states
    second = plant.simulate(first[:, -1], controls[:, 37:]).states
    np.testing.assert_array_equal(second.qpos, whole.qpos[:, 37:])
    np.testing.assert_array_equal(second.qvel, whole.qvel[:, 37:])


def test_it_survives_a_trip_to_another_process(robot: Robot, plant: Plant) -> None:
    controls = random_controls(robot, 1, 20, seed=5)
    there = pickle.loads(pickle.dumps(plant))
    ours, theirs = (p.simulate(p.rest(), controls).states.qpos for p in (plant, there))
    np.testing.assert_array_equal(ours, theirs)
    assert pickle.loads(pickle.dumps(robot)).digest == robot.digest


def test_the_oracle_foresees_the_plant_to_the_bit(robot: Robot, plant: Plant) -> None:
    controls = random_controls(robot, 1, 80, seed=6)
    truth = plant.simulate(plant.rest(), controls)
    seen = truth.observations[:, 20:31]
    past = Past(seen, controls[:, 20:30], seen.winch, state=truth.states[:, 30])
    foreseen = PlantDynamics(plant).rollout(past, np.repeat(controls[:, 30:], 3, axis=0))
    assert foreseen.points.shape == (3, 51, len(robot.points), 3)
    for candidate in foreseen.points:
        np.testing.assert_array_equal(candidate, truth.observations.points[0, 30:])


def test_holding_holds(robot: Robot, plant: Plant) -> None:
    middle = (robot.rest_low + robot.rest_high) / 2
    start = plant.rest()
    start = State(start.qpos, start.qvel, plant.activation(middle)[None])
    np.testing.assert_allclose(plant.winch(start)[0], middle)
    hold = np.repeat(robot.holding(middle)[None, None], 50, axis=1)
    winch = plant.simulate(start, hold).observations.winch
    np.testing.assert_allclose(winch, np.broadcast_to(middle, winch.shape), atol=1e-9)
