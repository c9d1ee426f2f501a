"""Weights on disk: to the bit, named by their content, refused where they do not belong."""

from __future__ import annotations

import json

import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import (
    ChunkNetwork,
    NetworkConfig,
    load_weights,
    save_weights,
    weights_digest,
)
from flywheel.dynamics.gnn.weights import network_from_arrays, read_about, weights_arrays
from flywheel.errors import ModelError

CONFIG = NetworkConfig.lean(width=8, rounds=1)


@pytest.fixture
def saved(robots, make_network, seed, tmp_path):
    network = make_network(robots["prism3"], CONFIG, seed)
    path = tmp_path / "weights.npz"
    return network, path, save_weights(network, path, snapshot="abc")


def test_weights_come_back_to_the_bit(robots, saved):
    network, path, digest = saved
    loaded = load_weights(path, robots["prism3"])
    assert loaded.config == network.config
    for name, value in network.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], value), name
    assert weights_digest(loaded) == digest == weights_digest(network)


def test_the_digest_tells_content_and_not_time(saved, tmp_path):
    network, _, digest = saved
    assert save_weights(network, tmp_path / "later.npz") == digest
    with torch.no_grad():
        bias = network.node_decoder.linears[0].bias
        bias[0] = torch.nextafter(bias[0], bias[0] + 1)
    assert weights_digest(network) != digest


def test_the_side_file_says_what_the_weights_are(robots, saved):
    network, path, digest = saved
    about = read_about(path)
    assert about["robot"] == robots["prism3"].digest
    assert (about["snapshot"], about["digest"]) == ("abc", digest)
    assert NetworkConfig.model_validate(about["config"]) == network.config
    mean = about["normalisation"]["normalisers.cable.mean"]
    np.testing.assert_allclose(mean, network.normalisers["cable"].mean, rtol=1e-6)


def test_weights_of_another_robot_are_refused(robots, saved):
    with pytest.raises(ModelError, match="trained for another robot"):
        load_weights(saved[1], robots["icosa6"])


def test_missing_weights_are_refused(robots, saved, tmp_path):
    with pytest.raises(ModelError, match="no weights"):
        load_weights(tmp_path / "nowhere.npz", robots["prism3"])
    saved[1].unlink()
    with pytest.raises(ModelError, match="no weights"):
        load_weights(saved[1], robots["prism3"])


def test_a_flipped_byte_anywhere_is_found(robots, saved, seed):
    path, rng = saved[1], np.random.default_rng(seed)
    whole = path.read_bytes()
    with np.load(path) as file:
        array = file["node_decoder.linears.0.weight"].tobytes()
    place = whole.index(array) + int(rng.integers(len(array)))
    path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
    with pytest.raises(ModelError, match="damaged"):
        load_weights(path, robots["prism3"])
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ModelError, match="damaged"):
        load_weights(path, robots["prism3"])


def test_a_side_file_of_other_weights_is_found(robots, saved):
    side = saved[1].with_suffix(".json")
    about = json.loads(side.read_text())
    side.write_text(json.dumps(about | {"digest": "0" * 64}))
    with pytest.raises(ModelError, match="damaged"):
        load_weights(saved[1], robots["prism3"])
    side.write_text("{}")
    with pytest.raises(ModelError, match="does not describe weights"):
        load_weights(saved[1], robots["prism3"])


def test_weights_travel_as_arrays(robots, saved):
    network = saved[0]
    again = network_from_arrays(robots["prism3"], network.config, weights_arrays(network))
    assert weights_digest(again) == saved[2]
    wide = NetworkConfig.lean(width=16, rounds=1)
    with pytest.raises(ModelError, match="do not fit"):
        network_from_arrays(robots["prism3"], wide, weights_arrays(network))


def test_reading_weights_draws_no_random_number(robots, saved):
    torch.manual_seed(3)
    load_weights(saved[1], robots["prism3"])
    after = torch.rand(1)
    torch.manual_seed(3)
    assert torch.equal(after, torch.rand(1))


def test_the_papers_network_is_as_large_as_the_papers(robots):
    """25.3 million weights without the LSTM, with features a little different from ours."""
    network = ChunkNetwork(robots["prism3"], NetworkConfig.paper(recurrent=False))
    assert network.parameter_count == pytest.approx(25.3e6, rel=0.1)
