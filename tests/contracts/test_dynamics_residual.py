"""A corrected plant keeps the contract of every dynamics model, on every shipped robot."""

import dataclasses

import numpy as np
import pytest

from flywheel.dynamics.protocol import Dynamics
from flywheel.dynamics.residual import ResidualDynamics
from flywheel.errors import ModelError
from flywheel.records import Observation, Past
from flywheel.robots import ROBOTS, load_robot
from tests import draws
from tests.unit.residual.cases import model_of, moving

HORIZON = 23  # not a multiple of the steps between corrections


@pytest.fixture(params=ROBOTS)
def robot(request):
    return load_robot(request.param)


@pytest.fixture
def model(robot) -> ResidualDynamics:
    return model_of(robot)


def asked(model, seed, batch):
    _, past, controls = moving(model.robot, seed, batch)
    return past, controls[:, :HORIZON]


def test_it_answers_the_protocol(model):
    assert isinstance(model, Dynamics)
    assert model.dt > 0 and model.history > 0


def test_shapes_and_finiteness(model):
    past, controls = asked(model, seed := draws.seed(), 3)
    got, robot = model.rollout(past, controls), model.robot
    assert got.points.shape == (3, HORIZON + 1, len(robot.points), 3)
    assert got.winch.shape == (3, HORIZON + 1, len(robot.winches))
    assert np.isfinite(got.points).all() and np.isfinite(got.winch).all(), seed


def test_bodies_stay_rigid(model):
    past, controls = asked(model, draws.seed(), 2)
    got = model.rollout(past, controls).points
    plant = model.plant.rollout(past, controls).points
    assert np.abs(got - plant).max() > 1e-4 * model.robot.length  # it does correct something
    for body in model.robot.bodies:
        own = list(body.points)
        here, there = (
            np.linalg.norm(p[:, :, own] - p[:, :, own[:1]], axis=-1) for p in (got, plant)
        )
        np.testing.assert_allclose(here, there, atol=1e-9)


def test_the_same_question_gets_the_same_answer_to_the_bit(model):
    past, controls = asked(model, draws.seed(), 2)
    first, second = model.rollout(past, controls), model.rollout(past, controls)
    assert np.array_equal(first.points, second.points)
    assert np.array_equal(first.winch, second.winch)


def test_a_batch_is_its_parts(model):
    past, controls = asked(model, seed := draws.seed(), 4)
    whole = model.rollout(past, controls).points
    for rows in (slice(0, 1), slice(1, 4)):
        part = Past(past.observations[rows], past.controls[rows], past.winch[rows])
        got = model.rollout(part, controls[rows]).points
        np.testing.assert_allclose(got, whole[rows], rtol=0, atol=1e-4, err_msg=str(seed))


def test_one_past_serves_all_candidates(model):
    past, controls = asked(model, draws.seed(), 3)
    one = Past(past.observations[:1], past.controls[:1], past.winch[:1])
    three = Past(
        *(
            Observation(*(np.repeat(a[:1], 3, axis=0) for a in vars(p).values()))
            if isinstance(p, Observation)
            else np.repeat(p[:1], 3, axis=0)
            for p in (past.observations, past.controls, past.winch)
        )
    )
    got, same = (model.rollout(p, controls).points for p in (one, three))
    np.testing.assert_allclose(got, same, rtol=0, atol=1e-4)


def test_controls_beyond_the_range_are_clipped(model):
    past, controls = asked(model, draws.seed(), 1)
    robot = model.robot
    high = controls > (robot.control_low + robot.control_high) / 2
    wild = np.where(high, robot.control_high, robot.control_low)
    more = np.where(high, robot.control_high + 1, robot.control_low - 1)
    assert np.array_equal(model.rollout(past, wild).points, model.rollout(past, more).points)


def test_a_wrong_number_of_winches_is_refused(model):
    past, controls = asked(model, 0, 1)
    with pytest.raises(ModelError, match="controls"):
        model.rollout(past, controls[..., 1:])


def test_a_robot_that_is_turned_and_moved_is_predicted_turned_and_moved(robot):
    if robot.tethered:
        pytest.skip("its cables end in the world, which does not turn with it")
    model = model_of(robot)
    past, controls = asked(model, seed := draws.seed(), 1)
    angle, shift = 1.1, np.array([0.7, -0.4, 0.0]) * robot.length
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    seen = past.observations
    moved = Observation(seen.points @ turn.T + shift, seen.winch)

    def off(past):
        plant = model.plant.rollout(past, controls).points
        return model.rollout(past, controls).points[:, :8] - plant[:, :8]

    here, there = off(past), off(dataclasses.replace(past, observations=moved))
    assert np.abs(here).max() > 1e-4 * robot.length
    np.testing.assert_allclose(
        there, here @ turn.T, atol=2e-3 * np.abs(here).max(), err_msg=str(seed)
    )
