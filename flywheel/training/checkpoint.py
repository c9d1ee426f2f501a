"""Checkpoints: the complete state of a training, for an exact continuation.

The order of the data and all random numbers are functions of (seed, step), so the state is the
weights, the optimiser, the step and the best weights so far. Files contain tensors and plain values
only and are read with `weights_only=True`: reading one runs no code.
"""

from __future__ import annotations

import os
import pickle
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile

import torch
from torch import Tensor

from flywheel.errors import ConfigError, DataError
from flywheel.files import opened, shown
from flywheel.outputs import write_output

CHECKPOINT = "checkpoint.pt"
_TYPES = {
    "key": str,
    "step": int,
    "weights": dict,
    "optimiser": dict,
    "averaged": dict,
    "best": dict,
    "best_error": float,
    "best_step": int,
    "stale": int,
    "curve": list,
}


@dataclass(frozen=True)
class Checkpoint:
    """The state of a training before `step`.

    Attributes:
      key: digest of everything that determines the result (configuration, robot, data, first
        weights).
      step: next step.
      weights: of the network.
      optimiser: its state.
      averaged: state of the averaged weights.
      best: weights with the least selection error so far; empty before the first validation.
      best_error: that error.
      best_step: steps done at their validation.
      stale: validations of the last stage since then.
      curve: points of the training curve, as plain values.
    """

    key: str
    step: int
    weights: dict[str, Tensor]
    optimiser: dict[str, Any]
    averaged: dict[str, Any]
    best: dict[str, Tensor]
    best_error: float
    best_step: int
    stale: int
    curve: list[dict[str, Any]]


def write_checkpoint(checkpoint: Checkpoint, folder: Path) -> Path:
    """Write `<folder>/checkpoint.pt` in one atomic and durable step."""
    content = BytesIO()  # written by torch itself, a full disk would be an error of its archives
    torch.save(dict(vars(checkpoint)), content)
    return write_output(folder / CHECKPOINT, content.getvalue())


def read_checkpoint(folder: Path, key: str, device: str = "cpu") -> Checkpoint | None:
    """Read the checkpoint of a folder; None if there is none.

    Raises:
      ConfigError: it belongs to a training with another configuration, robot, data or first
        weights.
      DataError: it is damaged.
    """
    path = folder / CHECKPOINT
    if not os.path.lexists(path):
        return None
    with opened(path, "checkpoint", DataError, limit=None) as file:
        checkpoint = _checked(path, _fields(path, file, device))
    if checkpoint.key != key:
        raise ConfigError(
            f"{path} belongs to a training with another configuration, robot, data or "
            f"first weights ({checkpoint.key[:12]}, this one is {key[:12]}); use another folder."
        )
    return checkpoint


def damaged(path: Path, why: object) -> DataError:
    """Message about an unusable checkpoint."""
    return DataError(f"{path} is damaged ({why}); remove it to train again from the start.")


def _fields(path: Path, file: BinaryIO, device: str) -> Any:
    try:
        with ZipFile(file) as archive:  # torch does not look at its checksums
            packed = [each.filename for each in archive.infolist() if each.compress_type]
            wrong = packed[0] if packed else archive.testzip()
        file.seek(0)
        if wrong is None:
            return torch.load(file, map_location=device, weights_only=True)
    except pickle.UnpicklingError:
        raise damaged(path, "it holds more than tensors and plain values") from None
    except Exception as error:  # of an archive's and a tensor's many kinds
        raise damaged(path, error) from None
    raise damaged(path, f"{wrong} was altered")


def _checked(path: Path, fields: Any) -> Checkpoint:
    """The fields of a checkpoint, checked for their types; their content is checked by torch."""
    if not isinstance(fields, dict) or fields.keys() != _TYPES.keys():
        raise damaged(path, f"it holds {shown(fields)}")
    for name, kind in _TYPES.items():
        if not isinstance(fields[name], kind):
            raise damaged(path, f"{name} is {shown(fields[name])}")
    return Checkpoint(**fields)
