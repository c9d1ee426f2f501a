"""The fast forward pass computes what the readable one does."""

import dataclasses

import pytest
import torch

from flywheel.dynamics.gnn import NetworkConfig, Simulator, ground_of
from flywheel.dynamics.gnn.fused import FusedForward
from flywheel.terrain import with_boxes
from tests.unit.gnn.conftest import boxes_around

WIDTH = 16
CONFIGS = {
    "lean": NetworkConfig.lean(width=WIDTH),
    "paper": NetworkConfig.paper(width=WIDTH),
    "paper in caps": NetworkConfig.paper(width=WIDTH, decomposition="caps"),
    "lean in primitives": NetworkConfig.lean(width=WIDTH, decomposition="primitives"),
    "lean without config features": NetworkConfig.lean(width=WIDTH, config_features=False),
    "paper without config features": NetworkConfig.paper(width=WIDTH, config_features=False),
    "lean without memory": NetworkConfig.lean(width=WIDTH, recurrent=False),
    "paper without memory": NetworkConfig.paper(width=WIDTH, recurrent=False),
    "lean with a learned winch": NetworkConfig.lean(width=WIDTH, winch="learned"),
    "lean with an analytic winch": NetworkConfig.lean(width=WIDTH, winch="analytic"),
    "paper with an analytic winch": NetworkConfig.paper(width=WIDTH, winch="analytic"),
    "lean without contact edges": NetworkConfig.lean(width=WIDTH, contact_edges=False),
    "lean with norms": NetworkConfig.lean(width=WIDTH, layer_norm=True),
    "paper without norms": NetworkConfig.paper(width=WIDTH, layer_norm=False),
    "lean, one step": NetworkConfig.lean(width=WIDTH, chunk=1),
    "lean, sixteen steps": NetworkConfig.lean(width=WIDTH, chunk=16),
    "lean without past controls": NetworkConfig.lean(width=WIDTH, control_history=0),
    "lean, deep": NetworkConfig.lean(width=WIDTH, mlp_layers=4, rounds=1),
    "lean beside boxes": NetworkConfig.lean(width=WIDTH, surfaces=3, contact_threshold=0.5),
    "paper beside boxes": NetworkConfig.paper(width=WIDTH, surfaces=2, contact_threshold=0.5),
    "paper in the robot's axes": NetworkConfig.paper(width=WIDTH, yaw_frame=True),
}

CASES = [("prism3", name) for name in CONFIGS]
CASES += [(robot, name) for robot in ("icosa6", "platform4") for name in ("lean", "paper")]
CASES += [("platform4", "lean in primitives")]


def relative(a: torch.Tensor, b: torch.Tensor) -> float:
    return float((a - b).abs().max() / b.abs().max())


def one_call(robot, config, network, window):
    """(fused, plain) predictions of one call, after the LSTM has seen the past."""
    from benchmarks.speed.reference import PlainForward  # PyG takes seconds to import

    simulator = Simulator(robot, config)
    parts = simulator.parts()
    start = simulator.start(window.past_points, window.past_controls, window.past_winch)
    predictions = []
    for forward in (FusedForward(network, parts.graph), PlainForward(network, parts.graph)):
        memory = None
        for state in start.states[:-1]:
            shown = parts.builder.memory_features(state, start.origin)
            memory = forward.warm_up(shown, window.dataset, memory)
        state, heading = start.states[-1], parts.builder.heading(start.states[-1])
        steps = config.control_history + config.chunk
        ramp = torch.linspace(-1.0, 1.0, len(robot.winches) * len(window.dataset) * steps)
        controls = ramp.view(len(robot.winches), len(window.dataset), steps)
        ground = ground_of([with_boxes(None, boxes_around(0))])
        features = parts.builder(state, start.origin, heading, controls, window.dataset, ground)
        predictions.append(forward(features, memory))
    return predictions


@pytest.mark.parametrize(("robot", "name"), CASES)
def test_the_fused_network_is_the_plain_one(robots, make_network, make_window, seed, robot, name):
    robot, config = robots[robot], CONFIGS[name]
    network = make_network(robot, config, seed)
    window = make_window(robot, config, seed, samples=5)
    with torch.no_grad():
        fused, plain = one_call(robot, config, network, window)
    assert fused.velocity.shape == (3, config.chunk, fused.velocity.shape[2], 5)
    assert relative(fused.velocity, plain.velocity) < 1e-5, seed
    assert (fused.winch is None) == (plain.winch is None) == (config.winch == "analytic")
    if fused.winch is not None:
        assert relative(fused.winch, plain.winch) < 1e-5, seed
    assert (fused.memory is None) == (plain.memory is None) == (not config.recurrent)
    for ours, theirs in zip(fused.memory or (), plain.memory or (), strict=True):
        assert relative(ours, theirs) < 1e-5, seed


@pytest.mark.parametrize("name", ["lean", "paper", "lean in primitives"])
def test_both_have_the_same_gradients(robots, make_network, make_window, seed, name):
    """In two of three draws: a unit that rounding puts on either side of its kink parts the third."""
    parted = []
    for draw in range(seed, seed + 3):
        fused, plain = both_gradients(
            robots["prism3"], CONFIGS[name], make_network, make_window, draw
        )
        assert fused.keys() == plain.keys()
        assert len(fused) > 20
        largest = {weight: plain[weight].abs().max() for weight in plain}
        parted.append(
            [
                weight
                for weight in plain
                if (fused[weight] - plain[weight]).abs().max() > 1e-4 * largest[weight] + 1e-9
            ]
        )
    assert sum(not weights for weights in parted) >= 2, (seed, parted)


def both_gradients(robot, config, make_network, make_window, seed):
    """(fused, plain): weight's name -> gradient of one loss."""
    network = make_network(robot, config, seed)
    window = make_window(robot, config, seed)
    gradients = []
    for prediction in one_call(robot, config, network, window):
        network.zero_grad()
        loss = prediction.velocity.square().mean()
        if prediction.winch is not None:
            loss = loss + prediction.winch.square().mean() * 1e3
        loss.backward()
        gradients.append(
            {n: p.grad.clone() for n, p in network.named_parameters() if p.grad is not None}
        )
    return gradients


def test_a_sample_alone_is_predicted_as_in_company(robots, make_network, make_window, seed):
    robot, config = robots["prism3"], CONFIGS["lean"]
    network = make_network(robot, config, seed)
    window = make_window(robot, config, seed, samples=7)
    simulator = Simulator(robot, config)
    with torch.no_grad():
        together = simulator.unroll(network, *window.arguments())
        alone = simulator.unroll(network, *(a[2:3] for a in window.arguments()))
    torch.testing.assert_close(alone.points, together.points[2:3], rtol=1e-5, atol=1e-5)


def test_several_cables_between_the_same_two_nodes_are_several_edges(
    robots, make_network, make_window, seed
):
    """Two cables from one anchor to one corner, beside corners with one cable or none."""
    robot = robots["platform4"]
    first = robot.cables[0]
    beside = dataclasses.replace(first, name="beside", winch=-1)
    one_winch = (dataclasses.replace(robot.winches[first.winch], cables=(0,)),)
    alone = (dataclasses.replace(first, winch=0), beside)  # a single anchor
    for here in (
        dataclasses.replace(robot, cables=(*robot.cables, beside)),
        dataclasses.replace(robot, cables=alone, winches=one_winch),
    ):
        network = make_network(here, CONFIGS["lean"], seed)
        window = make_window(here, CONFIGS["lean"], seed)
        with torch.no_grad():
            fused, plain = one_call(here, CONFIGS["lean"], network, window)
        assert relative(fused.velocity, plain.velocity) < 1e-5, seed
