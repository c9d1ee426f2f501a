"""Weights in a file: arrays without pickle, and a readable side file that says what they are."""

from __future__ import annotations

import hashlib
import json
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import ValidationError

from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.errors import ModelError
from flywheel.outputs import write_output
from flywheel.robots import Robot

_FORMAT = 2  # 1: cables between nodes


def weights_arrays(network: ChunkNetwork) -> dict[str, np.ndarray]:
    """Every weight and normalisation buffer by name; what is sent to other processes."""
    state = network.state_dict()
    return {name: value.detach().cpu().numpy().copy() for name, value in state.items()}


def network_from_arrays(
    robot: Robot, config: NetworkConfig, arrays: dict[str, np.ndarray]
) -> ChunkNetwork:
    """The network whose `weights_arrays` these are.

    Raises:
      ModelError: names or shapes are not those of this configuration on this robot.
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
    """Sha256 of robot, configuration and every array; the same for the same weights whenever saved."""
    return _digest(network.robot_digest, network.config, weights_arrays(network))


def save_weights(network: ChunkNetwork, path: Path | str, snapshot: str = "") -> str:
    """Write weights to `path` (.npz) and what they are beside it (.json); return their digest.

    Both files are replaced whole, the .npz first: a kill in between leaves a side file that does not
    match, which `load_weights` refuses.

    Args:
      network: to be saved.
      path: of the .npz file.
      snapshot: digest of the data set they were trained on.
    """
    path = Path(path)
    arrays = weights_arrays(network)
    digest = _digest(network.robot_digest, network.config, arrays)
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
    content = BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    write_output(path, content.getvalue())
    write_output(path.with_suffix(".json"), json.dumps(about, indent=1, sort_keys=True) + "\n")
    return digest


def read_about(path: Path | str) -> dict[str, Any]:
    """What the side file of weights at `path` says: digest, robot, snapshot, config, normalisation.

    Raises:
      ModelError: there is none, or it is no such file.
    """
    side = Path(path).with_suffix(".json")
    try:
        about: dict[str, Any] = json.loads(side.read_text())
        if about["format"] != _FORMAT:
            raise ModelError(
                f"{side} has format {about['format']!r}; this version reads format {_FORMAT}. Train the "
                "network anew, or read it with the version of this project that wrote it."
            )
    except FileNotFoundError:
        raise ModelError(f"There are no weights at {path}: {side.name} is missing.") from None
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError) as problem:
        raise ModelError(f"{side} does not describe weights: {problem}.") from problem
    return about


def load_weights(path: Path | str, robot: Robot) -> ChunkNetwork:
    """Read weights written by `save_weights`.

    Raises:
      ModelError: no such weights, damaged ones, or ones for another robot.
    """
    path, about = Path(path), read_about(path)
    if about["robot"] != robot.digest:
        raise ModelError(
            f"The weights {path.name} were trained for another robot (digest "
            f"{str(about['robot'])[:12]}), not for {robot.name} ({robot.digest[:12]}). Train a "
            "network for this robot, or load the MJCF that the weights belong to."
        )
    try:
        config = NetworkConfig.model_validate(about["config"])
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise ModelError(f"There are no weights at {path}.") from None
    except (ValidationError, ValueError, OSError, EOFError, zipfile.BadZipFile) as problem:
        raise ModelError(f"The weights {path} are damaged: {problem}.") from problem
    digest = _digest(robot.digest, config, arrays)
    if digest != about["digest"]:
        raise ModelError(
            f"The weights {path} are damaged: their digest is {digest[:12]}, their side file says "
            f"{str(about['digest'])[:12]}."
        )
    return network_from_arrays(robot, config, arrays)


def _digest(robot: str, config: NetworkConfig, arrays: dict[str, np.ndarray]) -> str:
    head = {"robot": robot, "config": config.model_dump(mode="json")}
    found = hashlib.sha256(json.dumps(head, sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        found.update(f"{name} {array.dtype.str} {array.shape}".encode())
        found.update(array.tobytes())
    return found.hexdigest()
