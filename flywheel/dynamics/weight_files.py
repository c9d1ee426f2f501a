"""Arrays in a file without pickle, and a readable side file that describes them.

The side file identifies the network, which determines the largest size of the file, and the names,
shapes and types of its arrays: these are checked before an array is read, and the digest before one
is used.
"""

from __future__ import annotations

import hashlib
import json
import math
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from pydantic import ValidationError
from torch import nn

from flywheel.errors import WeightsError
from flywheel.files import opened, read_json, shown
from flywheel.outputs import write_output
from flywheel.robots import Robot
from flywheel.validation import first_problem

Arrays = dict[str, np.ndarray]
Kinds = Mapping[str, type | tuple[type, ...]]
FORMAT = 1  # of a `StoredModel`
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
_LARGEST_HEADER = 1000  # overhead of an array in an .npz: header and directory entries [bytes]
_LARGEST_DIRECTORY = 1000  # everything else in an .npz [bytes]


@dataclass(frozen=True)
class Wanted:
    """Required shape and type of an array."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def nbytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize


def arrays_of(network: nn.Module) -> Arrays:
    """Every weight and buffer of a network by name."""
    state = network.state_dict()
    return {name: value.detach().cpu().numpy().copy() for name, value in state.items()}


def digest_of(head: Mapping[str, Any], arrays: Iterable[tuple[str, np.ndarray]]) -> str:
    """Sha256 of a network's identity and of its arrays, in the order of their names."""
    found = hashlib.sha256(json.dumps(head, sort_keys=True).encode())
    for name, array in arrays:
        array = np.ascontiguousarray(array)
        found.update(f"{name} {array.dtype.str} {array.shape}".encode())
        found.update(array.tobytes())
    return found.hexdigest()


def write_arrays(path: Path, arrays: Arrays, about: Mapping[str, Any]) -> None:
    """Write arrays to `path` (.npz) and their description next to it (.json).

    Both files are replaced atomically, the .npz first: a kill in between leaves a side file that
    does not match, and reading raises.

    Raises:
      WeightsError: the name ends in .json, like that of the description.
    """
    if path.suffix == ".json":
        raise WeightsError(f"Weights cannot be called {path.name}: call them .npz.")
    content = BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    write_output(path, content.getvalue())
    write_output(path.with_suffix(".json"), json.dumps(about, indent=1, sort_keys=True) + "\n")


def read_side_file(path: Path | str) -> dict[str, Any]:
    """Content of the side file of weights at `path`.

    Raises:
      WeightsError: it is missing or malformed.
    """
    side = Path(path).with_suffix(".json")
    if not side.exists():
        raise WeightsError(f"There are no weights at {path}: {side.name} is missing.")
    about = read_json(side, "side file of weights", WeightsError)
    if not isinstance(about, dict) or "format" not in about:
        raise WeightsError(f"{side} does not describe weights: it holds {shown(about)}.")
    return about


def checked_side_file(path: Path | str, format: int, kinds: Kinds) -> dict[str, Any]:
    """The same, checked for this format, with a digest, a robot and values of these types.

    Raises:
      WeightsError: it differs.
    """
    about, side = read_side_file(path), Path(path).with_suffix(".json")
    if about["format"] != format:
        raise WeightsError(
            f"{side} has format {shown(about['format'])}; this version reads format {format}. "
            "Train the network again, or read it with the version of this project that wrote it."
        )
    for name, kind in {"digest": str, "robot": str, **kinds}.items():
        if not isinstance(about.get(name), kind):
            got = f"is {shown(about[name])}" if name in about else "is missing"
            raise WeightsError(f"{side} does not describe weights: {name} {got}.")
    return about


def side_file_of(path: Path | str, robot: Robot, format: int, kinds: Kinds) -> dict[str, Any]:
    """The same, of a robot.

    Raises:
      WeightsError: it differs, or is for another robot.
    """
    about = checked_side_file(path, format, kinds)
    if about["robot"] != robot.digest:
        raise WeightsError(
            f"{Path(path).name} was trained for another robot (digest {about['robot'][:12]}), not for "
            f"{robot.name} ({robot.digest[:12]}). Train it again for this robot, or load the MJCF that it "
            "belongs to."
        )
    return about


@dataclass(frozen=True)
class StoredModel:
    """A model in its stored form, also for other processes.

    Attributes:
      robot: digest of its MJCF.
      arrays: its numbers, by name.
    """

    robot: str
    arrays: Arrays

    @property
    def head(self) -> dict[str, Any]:
        """Its identity except for the arrays, in JSON form."""
        raise NotImplementedError

    @property
    def digest(self) -> str:
        """Sha256 of its identity and every array."""
        return digest_of(self.head, sorted(self.arrays.items()))

    def write(self, path: Path | str, notes: Mapping[str, Any] | None = None) -> str:
        """Write the arrays to `path` and their description next to it (.json); return their digest.

        Args:
          path: of the file.
          notes: about the training, for people.

        Raises:
          WeightsError: the name ends in .json, like that of the side file.
        """
        digest = self.digest
        about = {**self.head, "format": FORMAT, "digest": digest, "notes": dict(notes or {})}
        write_arrays(Path(path), self.arrays, about)
        return digest


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Raise a `WeightsError` in the block for weights that are missing or damaged."""
    if not path.exists():
        raise WeightsError(f"There are no weights at {path}.")
    try:
        yield
    except ValidationError as problem:
        raise WeightsError(f"The weights {path} are damaged: {first_problem(problem)}.") from None
    except _DAMAGED as problem:
        raise WeightsError(f"The weights {path} are damaged: {problem}.") from problem


def read_arrays(
    path: Path, wanted: Mapping[str, Wanted], head: Mapping[str, Any], digest: str
) -> Arrays:
    """The arrays of a file, checked against their expected shapes and digest.

    Args:
      path: of the .npz file.
      wanted: arrays by name.
      head: identity of the network, see `digest_of`.
      digest: from the side file.

    Raises:
      WeightsError, and those of a damaged archive: they differ.
    """
    largest = _LARGEST_DIRECTORY + sum(w.nbytes + _LARGEST_HEADER for w in wanted.values())
    with opened(path, "file of weights", WeightsError, largest) as raw, ZipFile(raw) as archive:
        there = sorted(archive.namelist())
        if there != sorted(f"{name}.npy" for name in wanted):
            raise ValueError(
                f"they are not the {len(wanted)} arrays of their network: {shown(there)}"
            )
        # Twice: not all of them are held before they are known to be right.
        found = digest_of(head, _arrays_in(archive, wanted))
        if found != digest:
            raise ValueError(
                f"their digest is {found[:12]}, their side file says {shown(digest[:12])}"
            )
        return dict(_arrays_in(archive, wanted))


def _arrays_in(archive: ZipFile, wanted: Mapping[str, Wanted]) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays by name; one with a wrong header is not read."""
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
