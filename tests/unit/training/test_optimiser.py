"""Muon steps the hidden matrices, AdamW the rest."""

import pytest
import torch

from flywheel.dynamics.gnn import ChunkNetwork
from flywheel.training.optimiser import NetworkOptimiser

RATE = 1e-3


@pytest.fixture
def network(robot, network_config):
    torch.manual_seed(0)
    return ChunkNetwork(robot, network_config)


def stepped(network, config, steps=1):
    """Changes of the weights, by name, after steps down the same gradient of ones."""
    before = {name: weight.detach().clone() for name, weight in network.named_parameters()}
    optimiser = NetworkOptimiser(network, config)
    for weight in network.parameters():
        weight.grad = torch.ones_like(weight)
    for _ in range(steps):
        optimiser.step(RATE)
    return {name: weight.detach() - before[name] for name, weight in network.named_parameters()}


def test_hidden_matrices_are_those_of_the_lstm_the_rounds_and_the_decoders_but_for_the_last(
    network,
):
    inside = {id(weight) for weight in network.hidden_matrices()}
    names = {name for name, weight in network.named_parameters() if id(weight) in inside}
    parts = {name.split(".")[0] for name in names}
    assert parts == {"memory", "rounds", "node_decoder", "cable_decoder"}
    assert len(names) == 2 + (3 + 2) + 2
    assert all(weight.ndim == 2 for weight in network.hidden_matrices())
    assert "node_decoder.linears.0.weight" in names and "node_decoder.linears.1.weight" not in names


def test_without_a_rate_for_matrices_all_weights_are_adamws(network, make_config):
    for name, change in stepped(network, make_config(matrix_rate=0, weight_decay=0)).items():
        torch.testing.assert_close(change, torch.full_like(change, -RATE), msg=name)


def test_a_gradient_of_rank_one_moves_a_hidden_matrix_by_muons_step(network, make_config):
    inside = {id(weight) for weight in network.hidden_matrices()}
    hidden = {name for name, weight in network.named_parameters() if id(weight) in inside}
    moved = stepped(network, make_config(matrix_rate=3.0, weight_decay=0))
    for name, change in moved.items():
        if name not in hidden:
            torch.testing.assert_close(change, torch.full_like(change, -RATE), msg=name)
            continue
        # Its only singular value becomes 0.7 to 1.2, and the step as large as 0.2 per weight of a square.
        rows, columns = change.shape
        wanted = 3.0 * RATE * 0.2 * max(rows, columns) ** 0.5 / (rows * columns) ** 0.5
        assert change.max() < 0
        assert 0.6 < float(-change.mean()) / wanted < 1.3, name


def test_a_state_continues_where_it_was_kept(network, make_config):
    config = make_config()
    whole = NetworkOptimiser(network, config)
    start = {name: weight.detach().clone() for name, weight in network.named_parameters()}

    def step(optimiser, number):
        for i, weight in enumerate(network.parameters()):
            weight.grad = torch.full_like(weight, float((number + i) % 3 - 1)) + weight.detach()
        optimiser.step(RATE)

    for number in range(4):
        step(whole, number)
    wanted = [weight.detach().clone() for weight in network.parameters()]
    network.load_state_dict(start, strict=False)
    first = NetworkOptimiser(network, config)
    for number in range(2):
        step(first, number)
    second = NetworkOptimiser(network, config)
    second.load_state_dict(first.state_dict())
    for number in range(2, 4):
        step(second, number)
    assert all(torch.equal(a, b) for a, b in zip(network.parameters(), wanted, strict=True))
