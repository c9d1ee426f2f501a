"""Scales measured on data."""

from types import SimpleNamespace

import pytest
import torch

from flywheel.dynamics.gnn import (
    ChunkNetwork,
    NetworkConfig,
    Simulator,
    fit_normalisation,
    widen_winches,
)
from flywheel.dynamics.rigid_bodies.ground import flat_ground
from flywheel.errors import DataError


def split(window, rows=slice(None)):
    """The window as training gives it."""
    return SimpleNamespace(
        past_points=window.past_points[rows],
        past_controls=window.past_controls[rows],
        past_winch=window.past_winch[rows],
        controls=window.controls[rows],
        points=torch.cat([window.past_points[rows, -2:], window.points[rows]], dim=1),
        ground=flat_ground,
        winch=torch.full_like(window.controls[rows], torch.nan),
        dataset=window.dataset[rows],
    )


@pytest.mark.parametrize("name", ["prism3", "platform4"])
@pytest.mark.parametrize("config", [NetworkConfig.lean(width=8), NetworkConfig.paper(width=8)])
def test_normalised_features_have_mean_0_and_deviation_1(robots, make_window, seed, name, config):
    robot = robots[name]
    window = make_window(robot, config, seed, samples=200, steps=config.chunk)
    simulator, network = Simulator(robot, config), ChunkNetwork(robot, config)
    batches = [split(window, slice(0, 120)), split(window, slice(120, 200))]
    fit_normalisation(simulator, network, batches)
    parts = simulator.parts()
    start = simulator.start(window.past_points, window.past_controls, window.past_winch)
    state = start.states[-1]
    controls = torch.zeros(len(robot.winches), 200, config.control_history + config.chunk)
    heading = parts.builder.heading(state)
    shown = parts.builder(state, start.origin, heading, controls, window.dataset)
    for kind, values in {**shown.nodes, **shown.edges}.items():
        normaliser = network.normalisers[kind]
        rows = (values.flatten(1).t() - normaliser.mean) / normaliser.std
        varies = normaliser.fitted & (values.flatten(1).std(1) > 2e-3 * normaliser.scale)
        mean, std = rows.mean(0)[varies], rows.std(0)[varies]
        torch.testing.assert_close(mean, torch.zeros_like(mean), rtol=0, atol=1e-3)
        torch.testing.assert_close(std, torch.ones_like(std), rtol=0.02, atol=0)
        assert torch.equal(
            rows[:, ~normaliser.fitted], values.flatten(1).t()[:, ~normaliser.fitted]
        )


def test_output_scales_are_the_changes_since_the_chunks_start(robots, make_window, seed):
    robot, config = robots["prism3"], NetworkConfig.lean(width=8, winch="learned")
    window = make_window(robot, config, seed, samples=50, steps=6, spin=0.0)
    times = config.dt * torch.arange(1.0, 7.0)
    window.points.add_(
        0.5 * 9.81 * (times * (times + config.dt))[:, None, None]
    )  # falling, along all axes
    batch = split(window)
    batch.winch = window.past_winch[:, -1:] + torch.arange(1.0, 7.0)[:, None] * 0.01
    network = ChunkNetwork(robot, config)
    fit_normalisation(Simulator(robot, config), network, [batch])
    torch.testing.assert_close(network.velocity_scale, 9.81 * times, rtol=0.02, atol=0)
    torch.testing.assert_close(network.winch_scale, torch.arange(1.0, 7.0) * 0.01)


def test_without_winch_truth_its_scale_stays(robots, make_window, seed):
    robot, config = robots["prism3"], NetworkConfig.lean(width=8)
    network = ChunkNetwork(robot, config)
    before = network.winch_scale.clone()
    batch = split(make_window(robot, config, seed, steps=6))
    fit_normalisation(Simulator(robot, config), network, [batch])
    assert torch.equal(network.winch_scale, before)


def test_a_trained_network_speaks_in_larger_units_and_says_the_same(robots, make_window, seed):
    robot, config = robots["prism3"], NetworkConfig.lean(width=8)
    simulator, network = Simulator(robot, config), ChunkNetwork(robot, config)
    window = make_window(robot, config, seed, steps=config.chunk)
    obedient, slower = split(window), split(window)
    winches = simulator.parts().winches
    present = window.past_winch[:, -1].t()
    commands = winches.clipped(window.controls[:, : config.chunk].permute(1, 2, 0))
    obedient.winch = winches.nominal(present, commands).permute(2, 0, 1)
    slower.winch = winches.nominal(present, 0.8 * commands).permute(2, 0, 1)
    fit_normalisation(simulator, network, [obedient])
    small, last = network.winch_scale.clone(), network.cable_decoder.linears[-1]
    said = [(p * s).clone() for p, s in ((last.weight.t(), small), (last.bias, small))]
    widen_winches(simulator, network, [obedient, split(window)])
    assert torch.equal(network.winch_scale, small)
    widen_winches(simulator, network, [slower])
    off = (slower.winch - obedient.winch).square().mean((0, 2)).sqrt()
    torch.testing.assert_close(network.winch_scale, off)
    assert (network.winch_scale > 10 * small).all()
    for before, now in zip(said, (last.weight.t(), last.bias), strict=True):
        torch.testing.assert_close(now * network.winch_scale, before)


def test_no_windows_and_short_windows_are_refused(robots, make_window, seed):
    robot, config = robots["prism3"], NetworkConfig.lean(width=8)
    simulator, network = Simulator(robot, config), ChunkNetwork(robot, config)
    with pytest.raises(DataError, match="no training window"):
        fit_normalisation(simulator, network, [])
    short = split(make_window(robot, config, seed, steps=5))
    with pytest.raises(DataError, match="6 steps"):
        fit_normalisation(simulator, network, [short])
