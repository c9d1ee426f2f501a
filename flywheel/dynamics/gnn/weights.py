"""Weights in a file: arrays without pickle, and a readable side file that says what they are.

The side file says which network it is, and that network how large the file may be, and the names, shapes
and types of the arrays in it: that is looked at before an array is read, and the digest before one is kept.
"""

from __future__ import annotations

import hashlib
import json
import math
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
import torch
from pydantic import ValidationError

from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.errors import ModelError
from flywheel.files import opened, read_json, shown
from flywheel.outputs import write_output
from flywheel.robots import Robot
from flywheel.validation import first_problem

_FORMAT = 2  # 1: cables between nodes
_ABOUT = {"digest": str, "robot": str, "config": dict}
_LARGEST_HEADER = 1000  # overhead of an array in an .npz: header and directory entries [bytes]
_LARGEST_DIRECTORY = 1000  # everything else in an .npz [bytes]
_DEEPEST = 1000  # layers, or rounds
_NARROW = (4, 5)  # widths
_DAMAGED = (  # raised by a broken archive
    ValueError,
    OSError,
    EOFError,
    RuntimeError,
    NotImplementedError,
    OverflowError,
    BadZipFile,
    zlib.error,
)


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
    arrays = weights_arrays(network)
    return _digest(network.robot_digest, network.config, sorted(arrays.items()))


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
    digest = _digest(network.robot_digest, network.config, sorted(arrays.items()))
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
    if not side.exists():
        raise ModelError(f"There are no weights at {path}: {side.name} is missing.")
    about = read_json(side, "side file of weights", ModelError)
    if not isinstance(about, dict) or "format" not in about:
        raise ModelError(f"{side} does not describe weights: it holds {shown(about)}.")
    if about["format"] != _FORMAT:
        raise ModelError(
            f"{side} has format {shown(about['format'])}; this version reads format {_FORMAT}. Train the "
            "network anew, or read it with the version of this project that wrote it."
        )
    for name, kind in _ABOUT.items():
        if not isinstance(about.get(name), kind):
            got = shown(about[name]) if name in about else "nothing"
            raise ModelError(f"{side} does not describe weights: {name} is {got}.")
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
            f"{about['robot'][:12]}), not for {robot.name} ({robot.digest[:12]}). Train a "
            "network for this robot, or load the MJCF that the weights belong to."
        )
    if not path.exists():
        raise ModelError(f"There are no weights at {path}.")
    try:
        config = NetworkConfig.model_validate(about["config"])
        arrays = _read_arrays(path, robot, config, about["digest"])
    except ValidationError as problem:
        why = first_problem(problem)
        raise ModelError(
            f"The weights {path} are damaged: their network cannot be, {why}."
        ) from None
    except _DAMAGED as problem:
        raise ModelError(f"The weights {path} are damaged: {problem}.") from problem
    return network_from_arrays(robot, config, arrays)


@dataclass(frozen=True)
class Wanted:
    """An array as it has to be."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def nbytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize


def wanted_arrays(robot: Robot, config: NetworkConfig) -> dict[str, Wanted]:
    """Every weight and buffer of a network by name, without making it: it may claim to be huge.

    Each of its sizes is a multiple of the width and a constant, which two narrow networks tell.

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


def _read_arrays(
    path: Path, robot: Robot, config: NetworkConfig, digest: str
) -> dict[str, np.ndarray]:
    """The arrays of a file, if they are those of a network and have their digest.

    Raises:
      ModelError, ValueError, and what an archive raises: they are not.
    """
    wanted = wanted_arrays(robot, config)
    largest = _LARGEST_DIRECTORY + sum(w.nbytes + _LARGEST_HEADER for w in wanted.values())
    with opened(path, "file of weights", ModelError, largest) as raw, ZipFile(raw) as archive:
        there = sorted(archive.namelist())
        if there != sorted(f"{name}.npy" for name in wanted):
            raise ValueError(
                f"they are not the {len(wanted)} arrays of their network: {shown(there)}"
            )
        # Twice: not all of them are held before they are known to be right.
        found = _digest(robot.digest, config, _arrays_in(archive, wanted))
        if found != digest:
            raise ValueError(
                f"their digest is {found[:12]}, their side file says {shown(digest[:12])}"
            )
        return dict(_arrays_in(archive, wanted))


def _arrays_in(archive: ZipFile, wanted: Mapping[str, Wanted]) -> Iterator[tuple[str, np.ndarray]]:
    """Names and arrays by name; none is read whose header says that it is another."""
    for name in sorted(wanted):
        one = wanted[name]
        with archive.open(f"{name}.npy") as file:
            if (version := np.lib.format.read_magic(file)) != (1, 0):
                raise ValueError(f"{name} has the version {version} of NumPy's format, not (1, 0)")
            shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
            if (shape, dtype) != (one.shape, one.dtype) or fortran:
                raise ValueError(
                    f"{name} is {dtype} {shape}, and should be {one.dtype} {one.shape}"
                )
            content = file.read(one.nbytes + 1)
        if len(content) != one.nbytes:
            raise ValueError(f"{name} does not have {one.nbytes} bytes")
        yield name, np.frombuffer(content, one.dtype).reshape(one.shape)


def _digest(robot: str, config: NetworkConfig, arrays: Iterable[tuple[str, np.ndarray]]) -> str:
    """Sha256 of arrays, in the order of their names."""
    head = {"robot": robot, "config": config.model_dump(mode="json")}
    found = hashlib.sha256(json.dumps(head, sort_keys=True).encode())
    for name, array in arrays:
        array = np.ascontiguousarray(array)
        found.update(f"{name} {array.dtype.str} {array.shape}".encode())
        found.update(array.tobytes())
    return found.hexdigest()
