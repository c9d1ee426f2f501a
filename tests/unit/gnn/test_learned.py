"""The network as a dynamics model: numbers in, numbers out, blocks and threads in between."""

import dataclasses

import numpy as np
import pytest
import torch

from flywheel.dynamics.arithmetic import Arithmetic
from flywheel.dynamics.gnn import LearnedDynamics, NetworkConfig, Simulator, weights_digest
from flywheel.dynamics.threads import shares
from flywheel.dynamics.weight_files import arrays_of
from flywheel.errors import ModelError
from flywheel.records import Observation, Past
from flywheel.runtime.workers.model_weights import Weights

CONFIG = NetworkConfig.lean(width=16)


def past_of(window, rows=slice(None), dataset=2):
    def array(tensor):
        return tensor[rows].double().numpy()

    observations = Observation(array(window.past_points), array(window.past_winch))
    return Past(observations, array(window.past_controls), array(window.past_winch), dataset)


@pytest.fixture
def scene(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    window = make_window(robot, CONFIG, seed, samples=10, steps=14)
    return robot, make_network(robot, CONFIG, seed), window


def test_a_rollout_is_the_simulators_from_the_present_on(scene):
    robot, network, window = scene
    got = LearnedDynamics(robot, network).rollout(past_of(window), window.controls.numpy())
    dataset = torch.full((10,), 2)
    said = Simulator(robot, CONFIG).unroll(network, *window.arguments()[:4], dataset)
    assert got.points.shape == (10, 15, 6, 3) and got.winch.shape == (10, 15, 6)
    np.testing.assert_allclose(got.points[:, 1:], said.points.detach(), atol=1e-5)
    np.testing.assert_allclose(got.points[:, 0], window.past_points[:, -1], atol=1e-5)
    np.testing.assert_allclose(got.winch[:, 0], window.past_winch[:, -1], atol=1e-6)


@pytest.mark.parametrize("one_past", [True, False])
def test_blocks_and_threads_change_nothing(scene, one_past):
    robot, network, window = scene
    past = past_of(window, slice(0, 1) if one_past else slice(None))
    controls = window.controls.numpy()
    whole = LearnedDynamics(robot, network).rollout(past, controls)
    for threads, block in ((1, 3), (2, 3), (1, 1)):
        model = LearnedDynamics(robot, network, threads=threads, block=block)
        split = model.rollout(past, controls)
        np.testing.assert_allclose(split.points, whole.points, rtol=0, atol=1e-4)
        again = model.rollout(past, controls)
        assert np.array_equal(split.points, again.points)


def test_predictions_have_the_precision_of_their_arithmetic(scene):
    robot, network, window = scene
    past, controls = past_of(window), window.controls.numpy()
    weights = Weights(weights_digest(network), network.config, arrays_of(network))
    exact, rounded = (
        weights.dynamics(robot, arithmetic=Arithmetic("cpu", precision)).rollout(past, controls)
        for precision in ("float32", "bfloat16")
    )
    assert 1e-6 < np.abs(rounded.points - exact.points).max() < 0.05


def test_torch_keeps_its_own_threads(scene):
    robot, network, window = scene
    before = torch.get_num_threads()
    LearnedDynamics(robot, network, threads=2, block=4).rollout(
        past_of(window), window.controls.numpy()
    )
    assert torch.get_num_threads() == before


def test_later_changes_of_the_weights_have_no_effect(scene):
    robot, network, window = scene
    model = LearnedDynamics(robot, network)
    before = model.rollout(past_of(window), window.controls.numpy())
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.zero_()
    after = model.rollout(past_of(window), window.controls.numpy())
    assert np.array_equal(before.points, after.points)


def test_a_short_past_is_padded_by_rest(scene):
    robot, network, window = scene
    past = past_of(window)
    short = dataclasses.replace(
        past,
        observations=past.observations[:, -3:],
        controls=past.controls[:, -2:],
        winch=past.winch[:, -3:],
    )
    got = LearnedDynamics(robot, network).rollout(short, window.controls.numpy())
    assert np.isfinite(got.points).all()


def test_a_far_robot_is_predicted_as_a_near_one(scene):
    """Velocities are differences of positions: they must not lose digits far from the origin."""
    robot, network, window = scene
    near, model = past_of(window), LearnedDynamics(robot, network)
    shift = np.array([200.0, -300.0, 0.0])
    points = near.observations.points + shift
    far = dataclasses.replace(near, observations=Observation(points, near.winch))
    here, there = (model.rollout(p, window.controls.numpy()).points for p in (near, far))
    np.testing.assert_allclose(there - shift, here, atol=2e-3)


def test_what_does_not_fit_is_refused(robots, scene):
    robot, network, window = scene
    model, controls = LearnedDynamics(robot, network), window.controls.numpy()
    with pytest.raises(ModelError, match="controls must have shape"):
        model.rollout(past_of(window), controls[..., :3])
    with pytest.raises(ModelError, match="batch size"):
        model.rollout(past_of(window, slice(0, 4)), controls)
    with pytest.raises(ModelError, match="data sets"):
        model.rollout(past_of(window, dataset=10), controls)
    with pytest.raises(ModelError, match="made for robot"):
        LearnedDynamics(robots["icosa6"], network)


def test_a_prediction_that_is_not_finite_is_an_error_that_says_where(scene):
    robot, network, window = scene
    with torch.no_grad():
        network.node_decoder.linears[-1].bias[0] = torch.inf
    with pytest.raises(ModelError, match=r"candidate 0 from 0\.01 s on \(10 of 10"):
        LearnedDynamics(robot, network).rollout(past_of(window), window.controls.numpy())


@pytest.mark.parametrize("batch", [1, 48, 127, 128, 200, 1000])
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_blocks_are_equal_and_small_and_busy_all_threads_where_that_is_worth_it(batch, threads):
    blocks = shares(batch, 128, threads)
    sizes = [block.stop - block.start for block in blocks]
    assert [i for block in blocks for i in range(batch)[block]] == list(range(batch))
    assert max(sizes) <= 128 and max(sizes) - min(sizes) <= 1
    if batch <= 128:
        assert len(blocks) == 1
    if batch >= 65 * threads:
        assert len(blocks) % threads == 0
