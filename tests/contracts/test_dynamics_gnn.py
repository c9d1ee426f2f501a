"""The graph network keeps the contract of every dynamics model, on every shipped robot."""

import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import ChunkNetwork, LearnedDynamics, NetworkConfig
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import ModelError
from flywheel.records import Observation, Past
from flywheel.robots import ROBOTS, load_robot
from tests import draws

CONFIGS = {
    "lean": NetworkConfig.lean(width=16),
    "paper": NetworkConfig.paper(width=16),
    "no memory": NetworkConfig.lean(width=16, recurrent=False),
    "analytic winch": NetworkConfig.lean(width=16, winch="analytic"),
    "hybrid": NetworkConfig.hybrid(width=16),
}


@pytest.fixture(params=ROBOTS)
def robot(request):
    return load_robot(request.param)


@pytest.fixture(params=CONFIGS)
def model(request, robot):
    torch.manual_seed(0)
    return LearnedDynamics(robot, ChunkNetwork(robot, CONFIGS[request.param]))


def scattered(model, rng, batch):
    """A past of a robot that hardly moves, and controls from its whole range."""
    robot, history = model.robot, model.history
    points = rng.normal(0, 1.0, (batch, 1, len(robot.points), 3)) + [0, 0, 3]
    points = points + rng.normal(0, 1e-3, (batch, history + 1, len(robot.points), 3))
    winch = rng.uniform(robot.rest_low, robot.rest_high, (batch, 1, len(robot.winches)))
    winch = np.repeat(winch, history + 1, axis=1)

    def controls(steps):
        shape = (batch, steps, len(robot.winches))
        return rng.uniform(robot.control_low, robot.control_high, shape)

    return Past(Observation(points, winch), controls(history), winch), controls(13)


def test_it_answers_the_protocol(model):
    assert isinstance(model, Dynamics)
    assert model.dt > 0 and model.history >= 0


def test_shapes_and_finiteness(model):
    seed = draws.seed()
    past, controls = scattered(model, np.random.default_rng(seed), 5)
    got = model.rollout(past, controls)
    robot = model.robot
    assert got.points.shape == (5, 14, len(robot.points), 3)
    assert got.winch.shape == (5, 14, len(robot.winches))
    assert np.isfinite(got.points).all() and np.isfinite(got.winch).all(), seed
    assert (got.winch >= robot.rest_low - 1e-6).all(), seed
    assert (got.winch <= robot.rest_high + 1e-6).all(), seed


def test_the_same_question_gets_the_same_answer_to_the_bit(model):
    past, controls = scattered(model, np.random.default_rng(draws.seed()), 5)
    first, second = model.rollout(past, controls), model.rollout(past, controls)
    assert np.array_equal(first.points, second.points)
    assert np.array_equal(first.winch, second.winch)


def test_a_batch_is_its_parts(model):
    seed = draws.seed()
    past, controls = scattered(model, np.random.default_rng(seed), 6)
    whole = model.rollout(past, controls).points
    for rows in (slice(0, 1), slice(1, 4), slice(4, 6)):
        part = Past(past.observations[rows], past.controls[rows], past.winch[rows])
        got = model.rollout(part, controls[rows]).points
        np.testing.assert_allclose(got, whole[rows], rtol=0, atol=1e-3, err_msg=str(seed))


def test_controls_beyond_the_range_are_clipped(model):
    past, controls = scattered(model, np.random.default_rng(draws.seed()), 2)
    robot = model.robot
    wild = np.where(controls > np.median(controls), robot.control_high, robot.control_low)
    more = np.where(controls > np.median(controls), robot.control_high + 1, robot.control_low - 1)
    assert np.array_equal(model.rollout(past, wild).points, model.rollout(past, more).points)


def test_a_wrong_number_of_winches_is_refused(model):
    past, controls = scattered(model, np.random.default_rng(0), 2)
    with pytest.raises(ModelError, match="shape"):
        model.rollout(past, controls[..., 1:])
