"""Weights of a network in a file: arrays without pickle, and a readable side file that describes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.dynamics.weight_files import (
    Wanted,
    arrays_of,
    checked_side_file,
    digest_of,
    read_arrays,
    reading,
    side_file_of,
    write_arrays,
)
from flywheel.errors import ModelError
from flywheel.robots import Robot

_FORMAT = 3  # 1: cables between nodes; 2: nodes without loads
_ABOUT = {"config": dict}
_DEEPEST = 1000  # layers, or rounds
_NARROW = (4, 5)  # widths


def network_from_arrays(
    robot: Robot, config: NetworkConfig, arrays: dict[str, np.ndarray]
) -> ChunkNetwork:
    """The network with given arrays, see `arrays_of`.

    Raises:
      ModelError: names or shapes differ from those of this configuration on this robot.
    """
    with torch.random.fork_rng(devices=[]):  # the weights are replaced: draw no random number
        network = ChunkNetwork(robot, config)
    wanted = {name: tuple(value.shape) for name, value in network.state_dict().items()}
    got = {name: tuple(value.shape) for name, value in arrays.items()}
    if wanted != got:
        wrong = sorted(set(wanted.items()) ^ set(got.items()))
        raise ModelError(
            f"The weights do not fit {config!r} on robot {robot.name}; differing: "
            f"{', '.join(f'{name} {shape}' for name, shape in wrong[:6])}."
        )
    state = {name: torch.from_numpy(np.array(value)) for name, value in arrays.items()}
    network.load_state_dict(state)
    return network


def weights_digest(network: ChunkNetwork) -> str:
    """Sha256 of robot, configuration and every array; equal weights have equal digests."""
    head = _head(network.robot_digest, network.config)
    return digest_of(head, sorted(arrays_of(network).items()))


def save_weights(network: ChunkNetwork, path: Path | str, snapshot: str = "") -> str:
    """Write weights to `path` (.npz) and their description next to it (.json); return their digest.

    Both files are replaced atomically, the .npz first: a kill in between leaves a side file that
    does not match, and `load_weights` raises.

    Args:
      network: to be saved.
      path: of the .npz file.
      snapshot: digest of the training data.
    """
    path = Path(path)
    arrays, digest = arrays_of(network), weights_digest(network)
    about = {
        "format": _FORMAT,
        "digest": digest,
        "robot": network.robot_digest,
        "snapshot": snapshot,
        "parameters": network.parameter_count,
        "config": network.config.model_dump(mode="json"),
        "normalisation": {
            name: value.tolist()
            for name, value in arrays.items()
            if name.startswith("normalisers.") or name.endswith("_scale")
        },
    }
    write_arrays(path, arrays, about)
    return digest


def read_about(path: Path | str) -> dict[str, Any]:
    """Content of the side file of weights at `path`: digest, robot, snapshot, config, normalisation.

    Raises:
      ModelError: it is missing or malformed.
    """
    return checked_side_file(path, _FORMAT, _ABOUT)


def load_weights(path: Path | str, robot: Robot) -> ChunkNetwork:
    """Read weights written by `save_weights`.

    Raises:
      ModelError: weights are missing, damaged, or for another robot.
    """
    path, about = Path(path), side_file_of(path, robot, _FORMAT, _ABOUT)
    with reading(path):
        config = NetworkConfig.model_validate(about["config"])
        wanted = wanted_arrays(robot, config)
        arrays = read_arrays(path, wanted, _head(robot.digest, config), about["digest"])
    return network_from_arrays(robot, config, arrays)


def seeing(network: ChunkNetwork, robot: Robot, surfaces: int) -> ChunkNetwork:
    """The same weights with contact edges to another number of surfaces: all of these edges share theirs."""
    if network.config.surfaces == surfaces:
        return network
    config = network.config.model_copy(update={"surfaces": surfaces})
    return network_from_arrays(robot, config, arrays_of(network))


def wanted_arrays(robot: Robot, config: NetworkConfig) -> dict[str, Wanted]:
    """Every weight and buffer of a network by name, without making it: its claimed size may be huge.

    Each of its sizes is a multiple of the width plus a constant, which two narrow networks
    determine.

    Raises:
      ValueError: it is deeper than any of ours.
    """
    if max(config.rounds, config.mlp_layers) > _DEEPEST:
        raise ValueError(f"their network has more than {_DEEPEST} layers")
    with torch.random.fork_rng(devices=[]):
        narrow, wider = (
            ChunkNetwork(robot, config.model_copy(update={"width": width})).state_dict()
            for width in _NARROW
        )
    steps = config.width - _NARROW[0]
    return {
        name: Wanted(
            tuple(a + (b - a) * steps for a, b in zip(one.shape, wider[name].shape, strict=True)),
            np.dtype(str(one.dtype).removeprefix("torch.")),
        )
        for name, one in narrow.items()
    }


def _head(robot: str, config: NetworkConfig) -> dict[str, Any]:
    """Identity of a network, for its digest."""
    return {"robot": robot, "config": config.model_dump(mode="json")}
