"""The network on another device than the processor: the same numbers, and no tensor is left behind."""

import dataclasses

import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import LearnedDynamics, NetworkConfig
from flywheel.errors import ConfigError
from tests.other_device import OTHER, OtherDevice
from tests.unit.gnn.test_ground import hills
from tests.unit.gnn.test_learned import past_of

CONFIGS = {
    "lean": NetworkConfig.lean(width=16),
    "paper": NetworkConfig.paper(width=8),
    "hybrid": NetworkConfig.hybrid(width=16),
}


@pytest.mark.parametrize("rows", [1, 5], ids=["one past", "a past for each"])
@pytest.mark.parametrize("name", CONFIGS)
def test_a_rollout_on_another_device_is_that_of_the_processor(
    name, rows, robots, make_network, make_window, seed, monkeypatch
):
    robot, config, rng = robots["prism3"], CONFIGS[name], np.random.default_rng(seed)
    network = make_network(robot, config, seed)
    window = make_window(robot, config, seed, samples=5, steps=14)
    past, controls = past_of(window, slice(0, rows)), window.controls.numpy()
    past.observations.points[:, -3:-1, 2] = np.nan
    past = dataclasses.replace(past, terrains=(hills(rng), *[None] * (rows - 1)))
    said = LearnedDynamics(robot, network).rollout(past, controls)
    run = torch.no_grad()(LearnedDynamics._run.__wrapped__)  # it has no inference mode
    monkeypatch.setattr(LearnedDynamics, "_run", run)
    with OtherDevice():
        model = LearnedDynamics(robot, network, threads=2, block=2, device=OTHER)
        assert model.blocks(4096) == [slice(0, 4096)]
        there = model.rollout(past, controls)
    np.testing.assert_allclose(there.points, said.points, rtol=0, atol=1e-4)
    np.testing.assert_allclose(there.winch, said.winch, rtol=0, atol=1e-5)


def test_a_network_on_a_gpu_that_is_not_there_is_refused(robots, make_network, seed, monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    network = make_network(robots["prism3"], CONFIGS["lean"], seed)
    with pytest.raises(ConfigError, match="device=cuda needs a CUDA GPU"):
        LearnedDynamics(robots["prism3"], network, device="cuda")
