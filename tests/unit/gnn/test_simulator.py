"""Integration, rigidity and what a prediction may depend on."""

import dataclasses
from xml.etree import ElementTree

import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import NetworkConfig, Simulator
from flywheel.errors import ModelError
from flywheel.robots import read_robot

LEAN = NetworkConfig.lean(width=16)
PAPER = NetworkConfig.paper(width=8)


def silenced(network):
    """The network with decoders that say nothing."""
    with torch.no_grad():
        for decoder in (network.node_decoder, network.cable_decoder):
            for parameter in decoder.linears[-1].parameters() if decoder else ():
                parameter.zero_()
    return network


def saying(network, velocity, winch=None):
    """The network with decoders that always say the same: (3, n) [m/s], and (n,) [m]."""
    silenced(network)
    with torch.no_grad():
        bias = (velocity / network.velocity_scale).flatten()
        network.node_decoder.linears[-1].bias.copy_(bias)
        if winch is not None:
            network.cable_decoder.linears[-1].bias.copy_(winch / network.winch_scale)
    return network


@pytest.mark.slow
@pytest.mark.parametrize("config", [LEAN, PAPER], ids=["lean", "paper"])
@pytest.mark.parametrize("name", ["prism3", "icosa6", "platform4"])
def test_a_network_that_says_nothing_leaves_bodies_flying(
    robots, make_network, make_window, seed, name, config
):
    robot = robots[name]
    network = silenced(make_network(robot, config, seed))
    window = make_window(robot, config, seed, steps=50, spin=0.0)
    said = Simulator(robot, config).unroll(network, *window.arguments())
    torch.testing.assert_close(said.points, window.points, rtol=0, atol=2e-3)


def test_spinning_bodies_stay_rigid_and_nearly_keep_their_spin(
    robots, make_network, make_window, seed
):
    robot = robots["prism3"]
    network = silenced(make_network(robot, LEAN, seed))
    window = make_window(robot, LEAN, seed, steps=30, spin=0.3)
    said = Simulator(robot, LEAN).unroll(network, *window.arguments())
    rod = said.points[:, :, 1] - said.points[:, :, 0]
    torch.testing.assert_close(rod.norm(dim=-1), torch.full_like(rod[..., 0], robot.length))
    torch.testing.assert_close(said.points, window.points, rtol=0, atol=0.05)


@pytest.mark.parametrize("chunk", [1, 6])
def test_a_chunk_is_integrated_by_semi_implicit_euler(
    robots, make_network, make_window, seed, chunk
):
    robot, config = robots["prism3"], NetworkConfig.lean(width=16, chunk=chunk, yaw_frame=False)
    window = make_window(robot, config, seed, steps=chunk, spin=0.0)
    change = torch.randn(3, chunk, generator=torch.Generator().manual_seed(seed))
    network = saying(make_network(robot, config, seed), change)
    said = Simulator(robot, config).unroll(network, *window.arguments())
    before = (window.past_points[:, -1] - window.past_points[:, -2]) / config.dt
    velocities = before[:, None] + change.t()[None, :, None]
    positions = window.past_points[:, -1:] + config.dt * velocities.cumsum(dim=1)
    torch.testing.assert_close(said.velocities, velocities, rtol=0, atol=1e-3)
    torch.testing.assert_close(said.points, positions, rtol=0, atol=1e-5)


def test_the_next_chunk_starts_with_the_velocity_of_the_last_step(
    robots, make_network, make_window, seed
):
    robot, config = robots["prism3"], NetworkConfig.lean(width=16, yaw_frame=False)
    window = make_window(robot, config, seed, steps=12, spin=0.0)
    change = torch.randn(3, 6, generator=torch.Generator().manual_seed(seed))
    network = saying(make_network(robot, config, seed), change)
    said = Simulator(robot, config).unroll(network, *window.arguments())
    first, second = said.velocities[:, :6], said.velocities[:, 6:]
    expected = first[:, -1:] + change.t()[None, :, None]
    torch.testing.assert_close(second, expected, rtol=0, atol=2e-3)


@pytest.mark.parametrize("name", ["prism3", "platform4"])
def test_an_analytic_winch_is_the_robots_own(robots, make_network, make_window, seed, name):
    robot, config = robots[name], NetworkConfig.lean(width=16, winch="analytic")
    network = make_network(robot, config, seed)
    window = make_window(robot, config, seed, steps=300)
    said = Simulator(robot, config).unroll(network, *window.arguments())
    start, controls = window.past_winch[:, -1].numpy(), window.controls.numpy()
    nominal = robot.dead_reckon(start, controls, config.dt)[:, 1:]
    np.testing.assert_allclose(said.winch.numpy(), nominal, rtol=0, atol=2e-5)


@pytest.mark.parametrize("winch", ["learned", "residual"])
def test_a_decoded_winch_moves_as_the_decoder_says_within_its_range(
    robots, make_network, make_window, seed, winch
):
    robot, config = robots["prism3"], NetworkConfig.lean(width=16, winch=winch)
    way = 0.01 * torch.arange(1.0, 7.0)
    network = saying(make_network(robot, config, seed), torch.zeros(3, 6), way)
    window = make_window(robot, config, seed, steps=600)
    window = dataclasses.replace(window, controls=torch.zeros_like(window.controls))
    said = Simulator(robot, config).unroll(network, *window.arguments())
    high = torch.as_tensor(robot.rest_high, dtype=torch.float32)
    expected = torch.minimum(window.past_winch[:, -1:] + way[:, None], high)
    torch.testing.assert_close(said.winch[:, :6], expected, rtol=0, atol=1e-5)
    torch.testing.assert_close(said.winch[:, -1], high.expand_as(said.winch[:, -1]))


def test_without_a_winch_channel_the_keyframe_and_the_commands_tell(
    robots, make_network, make_window, seed
):
    robot, config = robots["prism3"], NetworkConfig.lean(width=16, winch="analytic")
    network = make_network(robot, config, seed)
    window = make_window(robot, config, seed)
    unknown = torch.full_like(window.past_winch, torch.nan)
    blind = dataclasses.replace(window, past_winch=unknown)
    said = Simulator(robot, config).unroll(network, *blind.arguments())
    start = np.array([robot.cables[w.cables[0]].rest_length for w in robot.winches])
    controls = torch.cat([window.past_controls, window.controls], dim=1).numpy()
    nominal = robot.dead_reckon(np.tile(start, (3, 1)), controls, config.dt)
    np.testing.assert_allclose(
        said.winch.numpy(), nominal[:, config.history + 1 :], rtol=0, atol=1e-5
    )


def test_gradients_are_finite_through_eight_chunks(robots, make_network, make_window, seed):
    for name, config in (("prism3", LEAN), ("prism3", PAPER), ("platform4", LEAN)):
        robot = robots[name]
        network = make_network(robot, config, seed)
        window = make_window(robot, config, seed, steps=8 * config.chunk)
        controls = window.controls.clone().requires_grad_()
        window = dataclasses.replace(window, controls=controls)
        said = Simulator(robot, config).unroll(network, *window.arguments())
        (said.points.square().mean() + said.winch.square().mean()).backward()
        gradients = [p.grad for p in network.parameters() if p.grad is not None]
        assert gradients and all(torch.isfinite(each).all() for each in gradients)
        assert torch.isfinite(controls.grad).all()
        assert controls.grad.abs().max() > 0
        memory = [p.grad.abs().max() for p in network.memory.parameters()]
        assert min(memory) > 0, "the LSTM learns"


def test_the_same_call_gives_the_same_bits(robots, make_network, make_window, seed):
    robot = robots["icosa6"]
    network = make_network(robot, LEAN, seed)
    window = make_window(robot, LEAN, seed)
    simulator = Simulator(robot, LEAN)
    first, second = (simulator.unroll(network, *window.arguments()) for _ in range(2))
    assert torch.equal(first.points, second.points)


def moved(window, shift, angle):
    """The window turned about the vertical by an angle [rad], then shifted."""
    cos, sin = np.cos(angle), np.sin(angle)
    turn = torch.tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def move(points):
        return (points.double() @ turn.T + torch.tensor(shift)).float()

    return dataclasses.replace(
        window, past_points=move(window.past_points), points=move(window.points)
    ), move


@pytest.mark.parametrize("config", [LEAN, PAPER], ids=["lean", "paper"])
@pytest.mark.parametrize("name", ["prism3", "icosa6"])
def test_a_shifted_robot_is_predicted_alike(robots, make_network, make_window, seed, name, config):
    robot = robots[name]
    network = make_network(robot, config, seed)
    window = make_window(robot, config, seed)
    other, move = moved(window, [3.0, -4.0, 0.0], 0.0)
    simulator = Simulator(robot, config)
    here = simulator.unroll(network, *window.arguments())
    there = simulator.unroll(network, *other.arguments())
    torch.testing.assert_close(there.points, move(here.points), rtol=0, atol=5e-4)


def test_a_turned_robot_is_predicted_alike_in_its_own_axes(robots, make_network, make_window, seed):
    robot, angle = robots["prism3"], 1.0 + seed % 4
    for yaw_frame, low, high in ((True, 0.0, 2e-3), (False, 4e-3, np.inf)):
        config = NetworkConfig.lean(width=16, yaw_frame=yaw_frame)
        network = make_network(robot, config, seed)
        window = make_window(robot, config, seed)
        other, move = moved(window, [0.0, 0.0, 0.0], angle)
        simulator = Simulator(robot, config)
        here = simulator.unroll(network, *window.arguments())
        there = simulator.unroll(network, *other.arguments())
        assert low <= (there.points - move(here.points)).abs().max() <= high


def relabelled(robot):
    """prism3 with its cables, winches and other rods in the opposite order."""
    root = ElementTree.fromstring(robot.xml)
    for name, first in (("worldbody", 5), ("tendon", 0), ("actuator", 0)):
        root.find(name)[first:] = reversed(root.find(name)[first:])
    key = root.find("keyframe/key")
    poses = np.reshape(key.get("qpos").split(), (3, 7))[[0, 2, 1]]
    key.set("qpos", " ".join(poses.ravel()))
    return read_robot(ElementTree.tostring(root, encoding="unicode"))


def test_weights_are_of_no_rod_cable_or_winch(robots, make_network, make_window):
    robot = robots["prism3"]
    other = relabelled(robot)
    names = [winch.name for winch in robot.winches]
    winch = [names.index(each.name) for each in other.winches]
    assert winch == [5, 4, 3, 2, 1, 0]
    window = make_window(robot, LEAN, 0)
    moved = dataclasses.replace(
        window,
        past_winch=window.past_winch[:, :, winch],
        past_controls=window.past_controls[:, :, winch],
        controls=window.controls[:, :, winch],
    )
    here, there = (
        Simulator(each, LEAN).unroll(make_network(each, LEAN, 0), *shown.arguments())
        for each, shown in ((robot, window), (other, moved))
    )
    torch.testing.assert_close(there.points, here.points, rtol=0, atol=5e-4)
    torch.testing.assert_close(there.winch, here.winch[:, :, winch], rtol=0, atol=5e-4)


def test_a_missing_point_is_filled_in_and_never_spreads(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    network = make_network(robot, LEAN, seed)
    window = make_window(robot, LEAN, seed, spin=0.0)
    gone = window.past_points.clone()
    gone[0, -4:, 1] = torch.nan
    gone[1, 3:5] = torch.nan
    gone[2, :2, 4] = torch.nan
    simulator = Simulator(robot, LEAN)
    whole = simulator.unroll(network, *window.arguments())
    holes = simulator.unroll(network, *dataclasses.replace(window, past_points=gone).arguments())
    assert torch.isfinite(holes.points).all()
    # a body that does not turn moves as its other point does, so nothing is lost
    torch.testing.assert_close(holes.points[0], whole.points[0], rtol=0, atol=1e-3)
    assert (holes.points - whole.points).abs().max() < 1.0


@pytest.mark.parametrize("every", [2, 3])
@pytest.mark.parametrize("phase", [0, 1])
def test_a_slower_log_gives_the_same_velocities(
    robots, make_network, make_window, seed, every, phase
):
    robot = robots["prism3"]
    network = make_network(robot, LEAN, seed)
    window = make_window(robot, LEAN, seed, spin=0.0)
    past = window.past_points
    drift = 0.01 * torch.arange(past.shape[1]).to(past)[None, :, None, None]
    steady = past[:, -1:] + drift * torch.tensor([1.0, -2.0, 0.5]).to(past)
    sparse = steady.clone()
    rows = torch.arange(past.shape[1])
    sparse[:, (past.shape[1] - 1 - phase - rows) % every != 0] = torch.nan
    simulator = Simulator(robot, LEAN)
    whole, holes = (
        simulator.unroll(network, *dataclasses.replace(window, past_points=p).arguments())
        for p in (steady, sparse)
    )
    torch.testing.assert_close(holes.points, whole.points, rtol=0, atol=1e-3)


def test_a_point_that_was_never_seen_is_refused_by_name(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    window = make_window(robot, LEAN, seed)
    window.past_points[:, :, 2] = torch.nan
    with pytest.raises(ModelError, match=robot.points[2].name):
        Simulator(robot, LEAN).unroll(make_network(robot, LEAN, seed), *window.arguments())


def test_one_past_serves_many_candidates(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    network = make_network(robot, LEAN, seed)
    window = make_window(robot, LEAN, seed, samples=4, steps=20)
    past = [a[:1] for a in window.arguments()[:3]]
    simulator = Simulator(robot, LEAN)
    shared = simulator.unroll(network, *past, window.controls, window.dataset[:1])
    repeated = simulator.unroll(
        network, *(a.expand(4, *a.shape[1:]) for a in past), window.controls, window.dataset[:1]
    )
    torch.testing.assert_close(shared.points, repeated.points, rtol=0, atol=1e-4)


def test_the_horizon_need_not_be_whole_chunks(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    network = make_network(robot, LEAN, seed)
    window = make_window(robot, LEAN, seed, steps=12)
    cut = dataclasses.replace(window, controls=window.controls[:, :8].clone())
    cut.controls[:, 6:] = 0.0
    held = dataclasses.replace(window, controls=window.controls.clone())
    held.controls[:, 6:] = 0.0
    simulator = Simulator(robot, LEAN)
    short, long = (simulator.unroll(network, *w.arguments()) for w in (cut, held))
    assert short.points.shape[1] == 8
    torch.testing.assert_close(short.points, long.points[:, :8], rtol=0, atol=1e-6)


def test_a_wrong_shape_is_refused_with_the_right_one(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    window = make_window(robot, LEAN, seed)
    network, simulator = make_network(robot, LEAN, seed), Simulator(robot, LEAN)
    short = dataclasses.replace(window, past_points=window.past_points[:, 1:])
    with pytest.raises(ModelError, match=r"past_points must have shape \(3, 21, 6, 3\)"):
        simulator.unroll(network, *short.arguments())
    with pytest.raises(ModelError, match="made for robot"):
        Simulator(robots["icosa6"], LEAN).prepare(network)
    with pytest.raises(ModelError, match="made for robot"):
        Simulator(robot, NetworkConfig.lean(width=8)).prepare(network)


def test_node_positions_are_nan_for_bodies_that_miss_a_point(robots, make_window, seed):
    robot = robots["prism3"]
    simulator = Simulator(robot, PAPER)
    points = make_window(robot, PAPER, seed).points
    nodes = simulator.node_positions(points)
    graph = simulator.parts().graph.nodes
    caps = [i for i, node in enumerate(graph) if node.point >= 0]
    order = [graph[i].point for i in caps]
    torch.testing.assert_close(nodes[..., caps, :], points[..., order, :], rtol=0, atol=1e-4)
    points[:, :, 2] = torch.nan
    lost = torch.isnan(simulator.node_positions(points)).all(-1)
    body = torch.tensor([node.body for node in graph])
    assert torch.equal(lost[0, 0], body == robot.points[2].body)
