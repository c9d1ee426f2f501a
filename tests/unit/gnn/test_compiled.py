"""Compiled kernels compute what torch operations compute, gradients too, and keep nothing afterwards."""

import dataclasses
import gc

import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig, Simulator
from flywheel.dynamics.gnn.compiled_network import CompiledForward, prepared
from flywheel.dynamics.gnn.fused import FusedForward
from flywheel.dynamics.gnn.step import TorchStep
from flywheel.dynamics.rigid_bodies.ground import flat_ground, ground_of
from flywheel.terrain import Terrain
from tests.unit.gnn.conftest import boxes_around

WIDTH = 16
CONFIGS = {
    "lean": NetworkConfig.lean(width=WIDTH),
    "paper": NetworkConfig.paper(width=WIDTH),
    "in primitives": NetworkConfig.lean(width=WIDTH, decomposition="primitives"),
    "in world axes": NetworkConfig.lean(width=WIDTH, yaw_frame=False),
    "with cables between nodes": NetworkConfig.lean(
        width=WIDTH, cable_ends="nodes", load_features=False
    ),
    "without load features": NetworkConfig.lean(width=WIDTH, load_features=False),
    "without config features": NetworkConfig.lean(width=WIDTH, config_features=False),
    "without contact edges": NetworkConfig.lean(width=WIDTH, contact_edges=False),
    "with a learned winch": NetworkConfig.lean(width=WIDTH, winch="learned"),
    "with an analytic winch": NetworkConfig.lean(width=WIDTH, winch="analytic"),
    "of one step": NetworkConfig.lean(width=WIDTH, chunk=1),
    "beside boxes": NetworkConfig.lean(
        width=WIDTH, surfaces=3, contact_threshold=0.5, ground_clamp=1.0
    ),
}
CASES = [("prism3", name) for name in CONFIGS]
CASES += [
    ("icosa6", "beside boxes"),
    ("icosa6", "lean"),
    ("platform4", "lean"),
    ("pair", "lean"),
    ("platform4", "with cables between nodes"),
]


def hills(seed):
    heights = 0.3 * np.random.default_rng(seed).random((9, 9))
    return ground_of([Terrain(heights, 1.0, (-4.0, -4.0), boxes_around(seed))])


def gradients(simulator, network, window, ground):
    """(prediction, gradients of one loss by name: of the weights and of the controls)."""
    network.zero_grad()
    controls = window.controls.clone().requires_grad_()
    window = dataclasses.replace(window, controls=controls)
    unrolled = simulator.unroll(network, *window.arguments(), ground)
    losses = (
        part.square().mean() / part.detach().square().mean()
        for part in (unrolled.node_positions, unrolled.velocities, unrolled.winch)
    )
    sum(losses).backward()
    return unrolled, {
        n: p.grad.clone() for n, p in network.named_parameters() if p.grad is not None
    }


def gap(ours, theirs):
    ours, theirs = ours.detach(), theirs.detach()
    return float((ours - theirs).norm() / theirs.norm().clamp(min=1e-9))


@pytest.mark.parametrize(("robot", "name"), CASES)
def test_kernels_and_torch_agree_and_so_do_their_gradients(
    robots, make_network, make_window, seed, robot, name
):
    """In two of three draws: a unit that rounding puts on either side of its kink parts the third."""
    robot, config, apart = robots[robot], CONFIGS[name], []
    for draw in range(seed, seed + 3):
        network, window = make_network(robot, config, draw), make_window(robot, config, draw)
        ground = hills(draw)
        plain = Simulator(robot, config, prepare=FusedForward, step=TorchStep)
        wanted, theirs = gradients(plain, network, window, ground)
        found, ours = gradients(Simulator(robot, config), network, window, ground)
        assert gap(found.node_positions, wanted.node_positions) < 1e-4, draw
        assert gap(found.velocities, wanted.velocities) < 1e-3, draw
        torch.testing.assert_close(found.winch, wanted.winch, rtol=1e-5, atol=1e-6)
        assert ours.keys() == theirs.keys() and len(ours) > 20
        largest = max(each.norm() for each in theirs.values())
        apart.append(
            [
                n
                for n in ours
                if (ours[n] - theirs[n]).norm() > 1e-4 * theirs[n].norm() + 1e-6 * largest
            ]
        )
    assert sum(not weights for weights in apart) >= 2, (seed, apart)


def test_products_in_bfloat16_deviate_by_its_rounding(robots, make_network, make_window, seed):
    robot, config = robots["prism3"], CONFIGS["lean"]
    network, window = make_network(robot, config, seed), make_window(robot, config, seed)
    wanted, theirs = gradients(Simulator(robot, config), network, window, flat_ground)
    rough = Simulator(robot, config, precision="bfloat16")
    found, ours = gradients(rough, network, window, flat_ground)
    start = wanted.node_positions[:, :1]
    assert 0 < gap(found.node_positions - start, wanted.node_positions - start) < 0.02
    whole, same = (torch.cat([g.flatten() for g in each.values()]) for each in (theirs, ours))
    assert ours.keys() == theirs.keys()
    assert 0 < gap(same, whole) < 0.1


def test_the_default_network_is_compiled_and_others_are_not(robots, make_network):
    def forward(name):
        network = make_network(robots["prism3"], CONFIGS[name], 0)
        return prepared(network, Simulator(robots["prism3"], network.config).parts().graph)

    assert isinstance(forward("lean"), CompiledForward)
    assert isinstance(forward("paper"), FusedForward)


def test_nothing_of_a_training_step_waits_for_the_garbage_collector(
    robots, make_network, make_window
):
    robot, config = robots["prism3"], CONFIGS["lean"]
    network: ChunkNetwork = make_network(robot, config, 0)
    simulator, window = Simulator(robot, config), make_window(robot, config, 0)

    def step():
        unrolled = simulator.unroll(network, *window.arguments())
        torch.autograd.grad(unrolled.points.sum(), list(network.parameters()), allow_unused=True)

    step()
    gc.collect()
    gc.set_debug(gc.DEBUG_SAVEALL)
    try:
        step()
        gc.collect()
        left = [each for each in gc.garbage if isinstance(each, torch.Tensor)]
    finally:
        gc.set_debug(0)
        gc.garbage.clear()
    assert left == []


@pytest.mark.parametrize("robot", ["prism3", "platform4"])
def test_positions_of_winches_depend_on_their_commands_alike(
    robots, make_network, make_window, seed, robot
):
    robot, config = robots[robot], CONFIGS["with an analytic winch"]
    network, window = make_network(robot, config, seed), make_window(robot, config, seed)
    found = []
    for how in ({"step": TorchStep}, {}):
        controls = window.controls.clone().requires_grad_()
        moved = dataclasses.replace(window, controls=controls)
        said = Simulator(robot, config, **how).unroll(network, *moved.arguments())
        found.append(torch.autograd.grad(said.winch.square().sum(), controls)[0])
    assert found[0].abs().max() > 0
    torch.testing.assert_close(found[1], found[0], rtol=1e-4, atol=1e-6)
