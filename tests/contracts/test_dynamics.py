"""Every dynamics model keeps the contract of `Dynamics`, on every shipped robot."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
import pytest
import torch

from flywheel.dynamics.baselines import LinearDynamics
from flywheel.dynamics.baselines.named import BASELINES
from flywheel.dynamics.gnn import ChunkNetwork, LearnedDynamics, NetworkConfig
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import ModelError
from flywheel.records import Floats, Observation, Past
from flywheel.robots import ROBOTS, Robot, load_robot
from tests import draws
from tests.unit.residual.cases import model_of, moving

HORIZON = 23  # not a multiple of the steps between corrections
CHUNKS = 13  # the same of networks, not a multiple of a chunk
Question = tuple[Past, Floats]  # and the controls


@functools.cache
def in_motion(name: str, seed: int, batch: int) -> Question:
    """A past of a plant under random controls, and those from there on."""
    _, past, controls = moving(load_robot(name), seed, batch)
    return past, controls[:, :HORIZON]


@functools.cache
def scattered(name: str, seed: int, batch: int) -> Question:
    """Points anywhere that hardly move, as no robot has them, and controls from the whole range."""
    robot, rng, history = load_robot(name), np.random.default_rng(seed), 30
    points = rng.normal(0, 1.0, (batch, 1, len(robot.points), 3)) + [0, 0, 3]
    points = points + rng.normal(0, 1e-3, (batch, history + 1, len(robot.points), 3))
    winch = rng.uniform(robot.rest_low, robot.rest_high, (batch, 1, len(robot.winches)))
    shape = (batch, history + CHUNKS, len(robot.winches))
    controls = rng.uniform(robot.control_low, robot.control_high, shape)
    past = Past(
        Observation(points, np.repeat(winch, history + 1, axis=1)),
        controls[:, :history],
        np.repeat(winch, history + 1, axis=1),
    )
    return past, controls[:, history:]


@dataclasses.dataclass(frozen=True)
class Kind:
    """A dynamics model of any robot.

    Attributes:
      make: one of a robot.
      ask: pasts and controls that it may be asked about, by the robot's name, a seed and their number.
      rounding: how far a prediction may be off that made in another batch [m].
    """

    make: Callable[[Robot], Dynamics]
    ask: Callable[[str, int, int], Question] = in_motion
    rounding: float = 1e-6


def linear(robot: Robot) -> LinearDynamics:
    """One that moves a little with its commands."""
    shape = LinearDynamics(robot, 0.01).coefficients.shape
    moves = 1e-4 * np.random.default_rng(0).normal(size=shape)
    return LinearDynamics(robot, 0.01, coefficients=moves)


def network(config: NetworkConfig, robot: Robot) -> LearnedDynamics:
    torch.manual_seed(0)
    return LearnedDynamics(robot, ChunkNetwork(robot, config))


NETWORKS = {
    "lean": NetworkConfig.lean(width=16),
    "paper": NetworkConfig.paper(width=16),
    "no memory": NetworkConfig.lean(width=16, recurrent=False),
    "analytic winch": NetworkConfig.lean(width=16, winch="analytic"),
    "hybrid": NetworkConfig.hybrid(width=16),
}
KINDS = {
    **{name: Kind(functools.partial(make, dt=0.01)) for name, make in BASELINES.items()},
    "arx": Kind(linear),
    "corrected": Kind(model_of, rounding=1e-4),
    **{n: Kind(functools.partial(network, c), scattered, 1e-3) for n, c in NETWORKS.items()},
}


@pytest.fixture(params=KINDS, scope="module")
def kind(request) -> Kind:
    return KINDS[request.param]


@pytest.fixture(params=ROBOTS, scope="module")
def robot(request) -> Robot:
    return load_robot(request.param)


@pytest.fixture(scope="module")
def model(kind: Kind, robot: Robot) -> Dynamics:
    return kind.make(robot)


def test_it_answers_the_protocol(model: Dynamics) -> None:
    assert isinstance(model, Dynamics)
    assert model.dt > 0 and model.history > 0


def test_shapes_and_finiteness(kind: Kind, model: Dynamics) -> None:
    past, controls = kind.ask(model.robot.name, seed := draws.seed(), 3)
    got, robot = model.rollout(past, controls), model.robot
    instants = controls.shape[1] + 1
    assert got.points.shape == (3, instants, len(robot.points), 3)
    assert got.winch.shape == (3, instants, len(robot.winches))
    assert np.isfinite(got.points).all() and np.isfinite(got.winch).all(), seed


def test_the_same_question_gets_the_same_answer_to_the_bit(kind: Kind, model: Dynamics) -> None:
    question = kind.ask(model.robot.name, draws.seed(), 3)
    first, second = model.rollout(*question), model.rollout(*question)
    assert np.array_equal(first.points, second.points)
    assert np.array_equal(first.winch, second.winch)


def part_of(past: Past, rows: slice | list[int]) -> Past:
    return Past(past.observations[rows], past.controls[rows], past.winch[rows])


def test_a_batch_is_its_parts(kind: Kind, model: Dynamics) -> None:
    past, controls = kind.ask(model.robot.name, seed := draws.seed(), 4)
    whole = model.rollout(past, controls).points
    for rows in (slice(0, 1), slice(1, 4)):
        got = model.rollout(part_of(past, rows), controls[rows]).points
        np.testing.assert_allclose(got, whole[rows], rtol=0, atol=kind.rounding, err_msg=str(seed))


def test_one_past_serves_all_candidates(kind: Kind, model: Dynamics) -> None:
    past, controls = kind.ask(model.robot.name, seed := draws.seed(), 3)
    one, many = part_of(past, slice(0, 1)), part_of(past, [0, 0, 0])
    got, wanted = (model.rollout(each, controls).points for each in (one, many))
    np.testing.assert_allclose(got, wanted, rtol=0, atol=kind.rounding, err_msg=str(seed))


def test_controls_beyond_the_range_are_clipped(kind: Kind, model: Dynamics) -> None:
    past, controls = kind.ask(model.robot.name, draws.seed(), 3)
    robot = model.robot
    high = controls > np.median(controls)
    wild = np.where(high, robot.control_high, robot.control_low)
    more = np.where(high, robot.control_high + 1, robot.control_low - 1)
    assert np.array_equal(model.rollout(past, wild).points, model.rollout(past, more).points)


def test_a_wrong_number_of_winches_is_refused(kind: Kind, model: Dynamics) -> None:
    past, controls = kind.ask(model.robot.name, draws.seed(), 3)
    with pytest.raises(ModelError):
        model.rollout(past, controls[..., 1:])


@pytest.fixture(params=[*BASELINES, "arx"], scope="module")
def baseline(request, robot: Robot) -> Dynamics:
    return KINDS[request.param].make(robot)


def test_a_baseline_begins_where_the_points_were_seen(baseline: Dynamics) -> None:
    past, controls = in_motion(baseline.robot.name, seed := draws.seed(), 3)
    present = baseline.rollout(past, controls).points[:, 0]
    off = np.abs(present - past.observations.points[:, -1]).max()
    assert off < 0.05 * baseline.robot.length, seed
    short = Past(past.observations[:, :1], past.controls[:, :0], past.winch[:, :1])
    assert np.isfinite(baseline.rollout(short, controls).points).all(), seed


def test_a_baseline_takes_a_missing_point_from_before(baseline: Dynamics) -> None:
    past, controls = in_motion(baseline.robot.name, draws.seed(), 3)
    points = past.observations.points.copy()
    points[:, -2:, 0] = np.nan
    gap = dataclasses.replace(past, observations=Observation(points, past.observations.winch))
    assert np.isfinite(baseline.rollout(gap, controls).points).all()
    points[:, :, 0] = np.nan
    with pytest.raises(ModelError, match="not seen"):
        baseline.rollout(gap, controls)


def test_networks_keep_winches_within_their_ranges(robot: Robot) -> None:
    past, controls = scattered(robot.name, seed := draws.seed(), 3)
    for config in NETWORKS.values():
        winch = network(config, robot).rollout(past, controls).winch
        assert (winch >= robot.rest_low - 1e-6).all(), seed
        assert (winch <= robot.rest_high + 1e-6).all(), seed


def test_a_corrected_plant_has_rigid_bodies(robot: Robot) -> None:
    model = model_of(robot)
    question = in_motion(robot.name, draws.seed(), 3)
    got, plant = model.rollout(*question).points, model.plant.rollout(*question).points
    assert np.abs(got - plant).max() > 1e-4 * robot.length  # it does correct something
    for body in robot.bodies:
        own = list(body.points)
        here, there = (
            np.linalg.norm(p[:, :, own] - p[:, :, own[:1]], axis=-1) for p in (got, plant)
        )
        np.testing.assert_allclose(here, there, atol=1e-9)


def test_a_correction_turns_and_moves_with_the_robot(robot: Robot) -> None:
    if robot.tethered:
        pytest.skip("its cables end in the world, which does not turn with it")
    model = model_of(robot)
    past, controls = in_motion(robot.name, seed := draws.seed(), 3)
    angle, shift = 1.1, np.array([0.7, -0.4, 0.0]) * robot.length
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    seen = past.observations
    moved = Observation(seen.points @ turn.T + shift, seen.winch)

    def off(past: Past) -> Floats:
        plant = model.plant.rollout(past, controls).points
        return model.rollout(past, controls).points[:, :8] - plant[:, :8]

    here, there = off(past), off(dataclasses.replace(past, observations=moved))
    assert np.abs(here).max() > 1e-4 * robot.length
    np.testing.assert_allclose(
        there, here @ turn.T, atol=2e-3 * np.abs(here).max(), err_msg=str(seed)
    )
