import dataclasses

import numpy as np
import pytest

from flywheel.dynamics.plant import (
    MeasurementModel,
    Plant,
    PlantDynamics,
    RestartedPlant,
    with_effects,
)
from flywheel.effects import EFFECTS, Term
from flywheel.errors import ModelError, RobotError
from flywheel.records import Observation, Past, State, Trajectory
from flywheel.robots import Robot, load_robot, read_robot
from flywheel.rotations import rotate
from tests.angles import angle_between
from tests.physics.small_robots import hanging

H = 20


def moving(robot: Robot, seed: int, batch: int = 4) -> tuple[Trajectory, Past]:
    """Trajectories under random controls, and the past at step 100 of them."""
    plant = Plant(robot)
    rng = np.random.default_rng(seed)
    low, high = robot.control_low, robot.control_high
    controls = np.repeat(rng.uniform(low, high, (batch, 10, len(low))), 20, axis=1)
    truth = plant.simulate(plant.rest(batch), controls)
    seen = truth.observations[:, 100 - H : 101]
    past = Past(seen, controls[:, 100 - H : 100], seen.winch, state=truth.states[:, 100])
    return truth, past


def row(past: Past, i: int) -> Past:
    only = slice(i, i + 1)
    return Past(past.observations[only], past.controls[only], past.winch[only])


@pytest.mark.parametrize("name", ["prism3", "icosa6", "platform4"])
def test_poses_fit_the_points_exactly(name: str) -> None:
    robot = load_robot(name)
    truth, past = moving(robot, seed=1)
    plant = Plant(robot)
    state = RestartedPlant(plant).estimate(past)
    points = plant.observe(state).points
    np.testing.assert_allclose(points, truth.observations.points[:, 100], atol=1e-9)
    np.testing.assert_allclose(state.act, truth.states.act[:, 100], atol=1e-12)


def test_a_plant_whose_markers_sit_elsewhere_is_restarted_where_they_are_seen() -> None:
    robot = load_robot("prism3")
    marker = Term(EFFECTS["marker_offset"], 0, (0.02, 0.03, -0.03))
    plant = with_effects(Plant(robot), (marker,))
    truth, past = moving(robot, seed=4, batch=8)  # markers change no motion
    at, states = slice(100, 140), truth.states
    seen = plant.observe(State(states.qpos[:, at], states.qvel[:, at], states.act[:, at])).points
    begun = plant.observe(
        State(states.qpos[:, 80:101], states.qvel[:, 80:101], states.act[:, 80:101])
    )
    past = dataclasses.replace(past, observations=begun)

    def off(model: Plant) -> float:
        restarted = RestartedPlant(model, roll="relaxed")
        points = restarted.rollout(past, truth.controls[:, 100:139]).points
        return float(np.median(np.abs(points - seen)))

    at_once = plant.observe(RestartedPlant(plant, roll="relaxed").estimate(past)).points
    np.testing.assert_allclose(at_once, seen[:, 0], atol=1e-9)
    assert off(plant) < 0.5 * off(Plant(robot))


@pytest.mark.parametrize("name", ["prism3", "platform4"])
def test_velocities_are_right_to_the_order_of_the_difference(name: str) -> None:
    """Everything but the spin of rods; half a step of lag with degree 1, none with degree 2."""
    robot = load_robot(name)
    truth, past = moving(robot, seed=2)
    plant = Plant(robot)
    after = 1e-5  # see where the estimated velocity carries the points
    points = truth.observations.points[:, 99:102]
    true_speed = (points[:, 2] - points[:, 0]) / 0.02
    for degree, allowed in ((1, 0.25), (2, 0.25)):
        state = RestartedPlant(plant, window=degree, degree=degree).estimate(past)
        moved = plant.observe(_advanced(state, after)).points - plant.observe(state).points
        error = np.linalg.norm(moved / after - true_speed, axis=-1)
        assert np.median(error) < allowed * np.median(np.linalg.norm(true_speed, axis=-1))


def _advanced(state: State, dt: float) -> State:
    """Moved by its velocity for a moment."""
    poses = state.qpos.reshape(len(state.qpos), -1, 7).copy()
    speeds = state.qvel.reshape(len(state.qvel), -1, 6)
    turning = rotate(poses[..., 3:], speeds[..., 3:])  # into the world
    poses[..., :3] += speeds[..., :3] * dt
    w, v = poses[..., 3:4], poses[..., 4:]
    change_w = -(turning * v).sum(axis=-1, keepdims=True)
    change_v = w * turning + np.cross(turning, v)
    poses[..., 3:] += dt / 2 * np.concatenate([change_w, change_v], axis=-1)
    return State(poses.reshape(len(poses), -1), state.qvel, state.act)


def test_rods_turn_about_themselves_by_chance_but_never_spin() -> None:
    robot = load_robot("prism3")
    _, past = moving(robot, seed=3)
    plant = Plant(robot)
    axis = np.array([0.0, 0.0, 1.0])
    models = [RestartedPlant(plant, seed=s) for s in (0, 1)]
    models += [RestartedPlant(plant, roll=t) for t in ("keyframe", "relaxed")]
    states = [model.estimate(past) for model in models]
    turns = [s.qpos.reshape(-1, 3, 7)[..., 3:] for s in states]
    axes = [rotate(turn, axis) for turn in turns]
    for other in axes[1:]:
        np.testing.assert_allclose(axes[0], other, atol=1e-12)
    across = [rotate(turn, np.array([1.0, 0.0, 0.0])) for turn in turns]
    assert angle_between(across[0], across[1]).min() > 0.005
    assert angle_between(across[0][0], across[0][1]).max() > 0.5  # drawn for each past anew
    again = RestartedPlant(plant).estimate(row(past, 1))
    np.testing.assert_array_equal(again.qpos[0], states[0].qpos[1])
    for state in states:
        spin = state.qvel.reshape(-1, 3, 6)[..., 5]
        np.testing.assert_allclose(spin, 0.0, atol=1e-9)


def test_a_robot_that_never_moved_is_restarted_as_it_is() -> None:
    robot = load_robot("prism3")
    plant = Plant(robot)
    seen = plant.observe(plant.rest()[:, None])
    past = Past(seen, np.zeros((1, 0, 6)), seen.winch)
    state = RestartedPlant(plant, roll="keyframe").estimate(past)
    np.testing.assert_allclose(state.qpos[0], robot.keyframe.qpos, atol=1e-9)
    np.testing.assert_allclose(state.qvel, 0.0, atol=1e-12)


def test_cables_tell_the_roll_that_nobody_sees() -> None:
    robot = load_robot("prism3")
    truth, past = moving(robot, seed=4, batch=8)
    plant = Plant(robot)
    across = np.array([1.0, 0.0, 0.0])
    true = rotate(truth.states.qpos[:, 100].reshape(-1, 3, 7)[..., 3:], across)
    found = RestartedPlant(plant, roll="relaxed").estimate(past).qpos.reshape(-1, 3, 7)[..., 3:]
    assert np.degrees(np.median(angle_between(rotate(found, across), true))) < 2.0


def test_the_better_the_guess_the_better_the_prediction() -> None:
    robot = load_robot("prism3")
    truth, past = moving(robot, seed=4, batch=12)
    plant = Plant(robot)
    future = truth.controls[:, 100:200]
    points = truth.observations.points[:, 100:]
    oracle = np.abs(PlantDynamics(plant).rollout(past, future).points - points).mean()
    errors = [
        np.abs(RestartedPlant(plant, roll=roll).rollout(past, future).points - points).mean()
        for roll in ("relaxed", "keyframe", "random")
    ]
    assert oracle == 0.0
    assert 0 < errors[0] < errors[1] < 0.5 * errors[2]


def test_a_past_of_one_starts_all_candidates_and_splits_do_not_matter() -> None:
    robot = load_robot("prism3")
    truth, past = moving(robot, seed=5)
    model = RestartedPlant(Plant(robot))
    whole = model.rollout(past, truth.controls[:, 100:120]).points
    first = row(past, 0)
    same = np.repeat(truth.controls[:1, 100:120], 3, axis=0)
    for candidate in model.rollout(first, same).points:
        np.testing.assert_array_equal(candidate, whole[0])


def test_longer_windows_resist_noise() -> None:
    robot = load_robot("prism3")
    truth, past = moving(robot, seed=6)
    plant = Plant(robot)
    noisy = MeasurementModel(noise=0.01).apply(past.observations, robot, np.random.default_rng(0))
    past = dataclasses.replace(past, observations=noisy)
    speeds = truth.states.qvel[:, 100].reshape(-1, 3, 6)[..., :3]
    errors = [
        np.abs(
            RestartedPlant(plant, w).estimate(past).qvel.reshape(-1, 3, 6)[..., :3] - speeds
        ).mean()
        for w in (1, 10)
    ]
    assert errors[1] < 0.3 * errors[0]


def test_points_that_are_missing_now_are_taken_from_before() -> None:
    robot = load_robot("prism3")
    truth, past = moving(robot, seed=7)
    plant = Plant(robot)
    points = past.observations.points.copy()
    points[:, -1, 2] = np.nan
    gone = dataclasses.replace(past, observations=Observation(points, past.observations.winch))
    state = RestartedPlant(plant, window=5).estimate(gone)
    off = plant.observe(state).points - truth.observations.points[:, 100]
    assert np.abs(off).max() < 0.1
    points[:, :, 2] = np.nan
    with pytest.raises(ModelError, match="not seen in the whole past"):
        RestartedPlant(plant).estimate(gone)


def test_what_cannot_be_restarted_is_refused() -> None:
    plant = Plant(load_robot("prism3"))
    with pytest.raises(ModelError, match="window must be at least 1"):
        RestartedPlant(plant, window=0)
    hinged = hanging().xml.replace("<freejoint/>", '<joint type="slide" axis="0 0 1"/>')
    hinged = hinged.replace('qpos="0 0 2.0 1 0 0 0"', 'qpos="0"')
    with pytest.raises(RobotError, match="cannot be restarted from its points: it has joints"):
        RestartedPlant(Plant(read_robot(hinged)))
    past = Past(
        Observation(np.zeros((1, 1, 6, 3)), np.zeros((1, 1, 6))),
        np.zeros((1, 0, 6)),
        np.zeros((1, 1, 6)),
    )
    with pytest.raises(ModelError, match="oracle needs the plant's full state"):
        PlantDynamics(plant).rollout(past, np.zeros((1, 5, 6)))
