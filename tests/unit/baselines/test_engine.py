"""The rigid-body engine as a model: it stands where the plant stands, and its numbers can be found."""

import numpy as np
import pytest
import torch

from flywheel.dynamics.baselines.engine import (
    CONTACT,
    LARGEST,
    LEAST,
    USUAL,
    EngineConfig,
    RigidBodyEngine,
)
from flywheel.dynamics.plant import Plant
from flywheel.dynamics.rigid_bodies.ground import flat_ground
from flywheel.errors import DataError, ModelError, RobotError
from flywheel.records import Observation, Past, State, Trajectory
from flywheel.robots import Robot, load_robot, read_robot
from flywheel.terrain import Terrain
from flywheel.training.baselines import FitSettings, fit
from tests.physics.small_robots import hanging

ROBOT = load_robot("prism3")
MJCF = EngineConfig(attachments="mjcf")
ENGINE = RigidBodyEngine(ROBOT, 0.01, MJCF)


def thrown(robot: Robot, numbers: np.ndarray, count: int, steps: int = 100) -> list[Trajectory]:
    """Throws along the ground, of a robot with these contact numbers."""
    engine, plant = RigidBodyEngine(robot, 0.01, MJCF, numbers), Plant(robot)
    rng = np.random.default_rng(3)
    state = plant.settle(1.0, count)
    qvel = state.qvel.reshape(count, -1, 6).copy()
    qvel[..., :2] += rng.uniform(-3, 3, (count, 1, 2))
    state = State(state.qpos, qvel.reshape(count, -1), state.act)
    winch = np.repeat(plant.winch(state)[:, None], steps + 1, axis=1)
    points = engine.simulate(state, engine.rest(winch), torch.tensor(numbers), flat_ground)
    return [
        Trajectory(Observation(p, w), np.zeros((steps, w.shape[1])), 0.01)
        for p, w in zip(points.permute(3, 0, 2, 1).numpy(), winch, strict=True)
    ]


def resting(robot: Robot, height: float = 0.0) -> Past:
    seen = Plant(robot).observe(Plant(robot).settle(3.0))
    points, winch = seen.points[:, None] + [0.0, 0.0, height], seen.winch[:, None]
    return Past(Observation(points, winch), np.zeros((1, 0, winch.shape[-1])), winch)


def test_the_friction_of_throws_is_found() -> None:
    truth = np.array([0.0, 0.2, 0.35, 0.9, 0.7])
    settings = FitSettings(horizon=0.2, steps=60, batch=48)
    found = fit(ENGINE, thrown(ROBOT, truth, 10), settings)
    assert found.error < 0.5 * found.before
    assert found.about["friction"] == pytest.approx(0.35, abs=0.07)
    assert (found.model.contact >= LEAST).all() and (found.model.contact <= LARGEST).all()


def test_equal_fits_give_equal_numbers() -> None:
    tracks, settings = thrown(ROBOT, USUAL, 6, 60), FitSettings(horizon=0.1, steps=3)
    first, second = (fit(ENGINE, tracks, settings).model for _ in range(2))
    assert np.array_equal(first.contact, second.contact)


def test_a_fit_can_be_stopped() -> None:
    steps: list[float] = []
    tracks, settings = thrown(ROBOT, USUAL, 6, 60), FitSettings(horizon=0.1, steps=50)
    found = fit(ENGINE, tracks, settings, lambda d, _: steps.append(d), lambda: len(steps) > 1)
    assert len(steps) < 5 and list(found.about) == list(CONTACT)


def test_a_robot_at_rest_hardly_moves() -> None:
    past = resting(ROBOT)
    got = RigidBodyEngine(ROBOT, 0.01, MJCF).rollout(past, np.zeros((2, 200, 6))).points
    assert np.abs(got - past.observations.points[:, :1]).max() < 0.05 * ROBOT.length


def test_it_stands_on_a_terrain() -> None:
    high = Terrain(np.full((40, 40), 0.7), 1.0, (-20.0, -20.0))
    past = resting(ROBOT, 0.7)
    past = Past(past.observations, past.controls, past.winch, terrains=(high,))
    got = RigidBodyEngine(ROBOT, 0.01, MJCF).rollout(past, np.zeros((1, 100, 6))).points
    assert np.abs(got - past.observations.points[:, :1]).max() < 0.05 * ROBOT.length


def test_a_simulation_that_diverges_says_so() -> None:
    engine = RigidBodyEngine(ROBOT, 0.01, MJCF, np.full(5, np.nan))
    with pytest.raises(ModelError, match="diverges"):
        engine.rollout(resting(ROBOT), np.zeros((1, 20, 6)))


def test_steps_are_short_enough_for_stiff_cables() -> None:
    slow, fast = (
        RigidBodyEngine(load_robot(name), dt, MJCF).substeps
        for name, dt in (("prism3", 0.01), ("prism3", 0.05))
    )
    assert slow < fast <= 6


def test_a_robot_with_joints_is_refused() -> None:
    hinged = hanging().xml.replace("<freejoint/>", '<joint type="slide" axis="0 0 1"/>')
    with pytest.raises(RobotError, match="joints"):
        RigidBodyEngine(read_robot(hinged.replace('qpos="0 0 2.0 1 0 0 0"', 'qpos="0"')), 0.01)


def test_a_recording_of_another_robot_is_refused() -> None:
    with pytest.raises(DataError, match="winches"):
        fit(RigidBodyEngine(load_robot("icosa6"), 0.01), thrown(ROBOT, USUAL, 1, 20))
