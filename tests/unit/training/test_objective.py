from dataclasses import replace

import pytest
import torch

from flywheel.dynamics.gnn import ChunkNetwork, Simulator, fit_normalisation
from flywheel.robots import Robot
from flywheel.training.objective import Objective


@pytest.fixture
def objective(robot, train, network_config, make_config):
    def make(**changes) -> Objective:
        config = make_config(**changes)
        return Objective(config, config.initial, Simulator(robot, network_config), train)

    return make


@pytest.fixture
def network(robot, network_config, objective):
    torch.manual_seed(0)
    network = ChunkNetwork(robot, network_config)
    fit_normalisation(Simulator(robot, network_config), network, [objective().measured()])
    return network


def _gradients(objective: Objective, network: ChunkNetwork, step: int) -> list[torch.Tensor]:
    objective.backward(network, step)
    return [w.grad.clone() for w in network.parameters() if w.grad is not None]


@pytest.mark.slow
def test_parts_of_a_batch_give_the_gradient_of_the_whole(objective, network):
    one, three = (_gradients(objective(processes=n), network, 7) for n in (1, 3))
    assert len(one) == len(three) > 0
    for a, b in zip(one, three, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-3, atol=1e-4)


def test_a_step_has_as_many_chunks_as_configured_and_as_few_windows_as_allowed(objective):
    """The first stage trains on one chunk per window, the second on two."""
    wide = objective(chunks_per_batch=16, least_windows=2)
    assert [len(wide.batch(step).points) for step in (0, 11)] == [16, 8]
    narrow = objective(chunks_per_batch=16, least_windows=12)
    assert [len(narrow.batch(step).points) for step in (0, 11)] == [16, 12]
    assert [narrow.batch(step).controls.shape[1] for step in (0, 11)] == [4, 8]


def test_windows_are_turned_only_for_a_network_that_does_not_turn_by_itself(
    robot, train, network_config, make_config
):
    config = make_config(symmetries=False)
    batches = []
    for yaw_frame in (True, False):
        network = network_config.model_copy(update={"yaw_frame": yaw_frame})
        batches.append(Objective(config, config.initial, Simulator(robot, network), train).batch(3))
    torch.testing.assert_close(batches[0].points[..., 2], batches[1].points[..., 2])
    assert (batches[0].points - batches[1].points).abs().max() > 0.1


def test_windows_of_a_robot_that_cables_hold_in_the_world_are_not_turned(
    monkeypatch, robot, train, network_config, make_config
):
    network = network_config.model_copy(update={"yaw_frame": False})
    for tethered in (False, True):
        monkeypatch.setattr(Robot, "tethered", tethered)
        config = make_config(symmetries=False)
        plain = make_config(symmetries=False, yaw_augmentation=False)
        seen, given = (
            Objective(each, each.initial, Simulator(replace(robot), network), train).batch(3).points
            for each in (config, plain)
        )
        assert torch.equal(seen, given) == tethered


def test_noise_is_in_the_past_alone(objective):
    clean, noisy = (objective(noise=n).batch(3) for n in (0.0, 0.01))
    spread = (noisy.past_points - clean.past_points).diff(dim=1).std() / 2**0.5
    assert spread.item() == pytest.approx(0.0295, rel=0.2)
    apart = (noisy.points[:, 2:] - clean.points[:, 2:]).diff(dim=1)
    torch.testing.assert_close(apart, torch.zeros_like(apart), atol=1e-5, rtol=0)


@pytest.mark.parametrize("name, some", [("nominal", True), ("recording", False)])
def test_simulated_windows_are_listed_from_other_sides_where_that_is_asked_for(
    robot, train, network_config, make_config, name, some
):
    cache, simulator = replace(train, datasets=(name,)), Simulator(robot, network_config)
    plain, listed = (
        Objective(config, config.initial, simulator, cache).batch(3)
        for config in (make_config(symmetries=on) for on in (False, True))
    )
    torch.testing.assert_close(plain.points.mean(dim=2), listed.points.mean(dim=2))
    other = (plain.points != listed.points).flatten(1).any(dim=1)
    assert bool(other.any()) == some and not other.all()
