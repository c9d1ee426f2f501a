"""The ground below the network's nodes."""

import dataclasses

import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import LearnedDynamics, NetworkConfig, Simulator, View, ground_of
from flywheel.dynamics.gnn.ground import flat_ground
from flywheel.errors import DataError
from flywheel.records import Observation, Past
from flywheel.terrain import Terrain

# Far enough that every node sees the ground, near enough that hills are more than a rounding of it.
LEAN = NetworkConfig.lean(width=16, ground_clamp=20.0)


def hills(rng: np.random.Generator) -> Terrain:
    """Uneven ground that reaches at least 5 m from the robot's place to every side."""
    shape = tuple(int(n) for n in rng.integers(26, 40, 2))
    cell = float(rng.uniform(0.4, 0.9))
    origin = tuple(float(-cell * n * rng.uniform(0.48, 0.52)) for n in shape)
    return Terrain(rng.uniform(-0.3, 0.3, shape), cell, origin)


def test_it_is_the_terrains_own_surface(seed: int) -> None:
    rng = np.random.default_rng(seed)
    terrains = (hills(rng), None, hills(rng), hills(rng))
    which = rng.integers(0, 4, 30)
    places = rng.uniform(-12.0, 12.0, (2, 7, 30))
    ground = ground_of([terrains[i] for i in which])
    heights, normals = ground(torch.from_numpy(places).float())
    for sample, index in enumerate(which):
        terrain, here = terrains[index], places[:, :, sample].T
        flat = np.zeros(7), np.tile([0.0, 0.0, 1.0], (7, 1))
        expected = flat if terrain is None else terrain.at(here)
        off = np.abs(heights[:, sample].numpy() - expected[0])
        assert (off < 1e-4).sum() >= 6, seed  # rounding may step over an edge
        turned = np.abs(normals[:, :, sample].numpy().T - expected[1]).max(axis=1)
        assert (turned < 1e-3).sum() >= 6, seed


def test_a_plane_needs_no_lookup() -> None:
    assert ground_of([None]) is flat_ground
    assert ground_of([None, None, None]) is flat_ground


def test_samples_seen_from_elsewhere_stand_on_the_same_ground(seed: int) -> None:
    rng = np.random.default_rng(seed)
    terrain, angle = hills(rng), rng.uniform(-np.pi, np.pi, 20)
    places, shift = rng.uniform(-6.0, 6.0, (2, 5, 20)), rng.uniform(-3.0, 3.0, (2, 20))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    seen = np.einsum("ijk,jnk->ink", turn, places) - shift[:, None]
    view = View(torch.from_numpy(angle).float(), torch.from_numpy(shift).float())
    heights, normals = ground_of([terrain], view=view)(torch.from_numpy(seen).float())
    expected, upright = terrain.at(np.moveaxis(places, 0, -1))
    off = np.abs(heights.numpy() - expected)
    assert np.quantile(off, 0.95) < 1e-4, seed
    upright = np.moveaxis(upright, -1, 0)
    upright[:2] = np.einsum("ijk,jnk->ink", turn, upright[:2])
    assert np.quantile(np.abs(normals.numpy() - upright), 0.95) < 1e-3, seed


def test_predictions_turn_with_robot_and_ground_alike(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    network, window = make_network(robot, LEAN, seed), make_window(robot, LEAN, seed)
    simulator, rng = Simulator(robot, LEAN), np.random.default_rng(seed)
    terrain, angle = hills(rng), float(rng.uniform(-np.pi, np.pi))
    cos, sin = np.cos(angle), np.sin(angle)
    turn = torch.tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]).float()
    other = dataclasses.replace(window, past_points=window.past_points @ turn.t())
    view = View(torch.full((3,), angle), torch.zeros(2, 3))
    here = simulator.unroll(network, *window.arguments(), ground_of([terrain])).points
    there = simulator.unroll(network, *other.arguments(), ground_of([terrain], view=view)).points
    flat = simulator.unroll(network, *window.arguments()).points
    assert not torch.equal(here, flat)
    off = (here @ turn.t() - there).abs()
    assert off.median() < 1e-4, seed


def test_a_planner_stands_on_what_the_past_says(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    window, rng = make_window(robot, LEAN, seed), np.random.default_rng(seed)
    model = LearnedDynamics(robot, make_network(robot, LEAN, seed), block=2)
    arrays = [a.double().numpy() for a in window.arguments()[:4]]
    past = Past(Observation(arrays[0], arrays[2]), arrays[1], arrays[2])
    terrains = (hills(rng), None, hills(rng))
    uneven = dataclasses.replace(past, terrains=terrains)
    together = model.rollout(uneven, arrays[3]).points
    flat = model.rollout(past, arrays[3]).points
    assert np.abs(together[1] - flat[1]).max() < 1e-4
    for row in (0, 2):
        assert not np.array_equal(together[row], flat[row]), seed
        alone = dataclasses.replace(past, terrains=(terrains[row],))
        np.testing.assert_allclose(
            model.rollout(alone, arrays[3]).points[row], together[row], atol=1e-4
        )
    with pytest.raises(DataError, match="as many terrains"):
        dataclasses.replace(past, terrains=(None, None))
