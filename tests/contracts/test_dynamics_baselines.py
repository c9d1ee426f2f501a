"""Every baseline keeps the contract of every dynamics model, on every shipped robot."""

import dataclasses

import numpy as np
import pytest

from flywheel.dynamics.baselines import LinearDynamics
from flywheel.dynamics.baselines.named import BASELINES
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import ModelError
from flywheel.records import Observation, Past
from flywheel.robots import ROBOTS, load_robot
from tests import draws
from tests.unit.residual.cases import moving

HORIZON = 23


def linear(robot, dt, threads=1):
    """One that moves a little with its commands."""
    shape = LinearDynamics(robot, dt).coefficients.shape
    return LinearDynamics(
        robot, dt, coefficients=1e-4 * np.random.default_rng(0).normal(size=shape)
    )


MODELS = {**BASELINES, "arx": linear}


@pytest.fixture(params=ROBOTS)
def robot(request):
    return load_robot(request.param)


@pytest.fixture(params=MODELS)
def model(request, robot) -> Dynamics:
    return MODELS[request.param](robot, 0.01, 1)


def asked(model, seed, batch):
    _, past, controls = moving(model.robot, seed, batch)
    return past, controls[:, :HORIZON]


def test_it_answers_the_protocol(model) -> None:
    assert isinstance(model, Dynamics)
    assert model.dt > 0 and model.history > 0


def test_shapes_and_finiteness(model) -> None:
    past, controls = asked(model, seed := draws.seed(), 3)
    got, robot = model.rollout(past, controls), model.robot
    assert got.points.shape == (3, HORIZON + 1, len(robot.points), 3)
    assert got.winch.shape == (3, HORIZON + 1, len(robot.winches))
    assert np.isfinite(got.points).all() and np.isfinite(got.winch).all(), seed
    off = np.abs(got.points[:, 0] - past.observations.points[:, -1]).max()
    assert off < 0.05 * robot.length, seed  # the present is where it was seen


def test_a_batch_is_its_parts(model) -> None:
    past, controls = asked(model, seed := draws.seed(), 4)
    whole = model.rollout(past, controls).points
    for rows in (slice(0, 1), slice(1, 4)):
        part = Past(past.observations[rows], past.controls[rows], past.winch[rows])
        got = model.rollout(part, controls[rows]).points
        np.testing.assert_allclose(got, whole[rows], rtol=0, atol=1e-6, err_msg=str(seed))


def test_one_past_serves_all_candidates(model) -> None:
    past, controls = asked(model, seed := draws.seed(), 3)
    one = Past(past.observations[:1], past.controls[:1], past.winch[:1])
    many = Past(*(
        Observation(np.repeat(p.points, 3, 0), np.repeat(p.winch, 3, 0)) if isinstance(p, Observation)
        else np.repeat(p, 3, 0) for p in (one.observations, one.controls, one.winch)
    ))  # fmt: skip
    got, wanted = (model.rollout(p, controls).points for p in (one, many))
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-6, err_msg=str(seed))


def test_it_begins_where_an_episode_begins(model) -> None:
    past, controls = asked(model, draws.seed(), 2)
    short = Past(past.observations[:, :1], past.controls[:, :0], past.winch[:, :1])
    assert np.isfinite(model.rollout(short, controls).points).all()


def test_controls_beyond_the_range_are_clipped(model) -> None:
    past, controls = asked(model, draws.seed(), 2)
    robot = model.robot
    wild = np.where(controls > np.median(controls), robot.control_high, robot.control_low)
    more = np.where(controls > np.median(controls), robot.control_high + 1, robot.control_low - 1)
    got, wanted = (model.rollout(past, c).points for c in (more, wild))
    assert np.array_equal(got, wanted)


def test_a_missing_point_is_taken_from_before(model) -> None:
    past, controls = asked(model, draws.seed(), 2)
    points = past.observations.points.copy()
    points[:, -2:, 0] = np.nan
    gap = dataclasses.replace(past, observations=Observation(points, past.observations.winch))
    assert np.isfinite(model.rollout(gap, controls).points).all()
    points[:, :, 0] = np.nan
    with pytest.raises(ModelError, match="not seen"):
        model.rollout(gap, controls)


def test_a_wrong_number_of_winches_is_refused(model) -> None:
    past, controls = asked(model, 0, 2)
    with pytest.raises(ModelError):
        model.rollout(past, controls[..., 1:])
