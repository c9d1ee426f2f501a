"""Checkpoints: everything a training needs to go on as if it had never been interrupted.

The order of the data and all random numbers are functions of (seed, step), so that the state is the
weights, the optimiser, the step and the best weights so far. Files hold tensors and plain values
only and are read with `weights_only=True`: reading one runs no code.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from flywheel.errors import ConfigError, DataError
from flywheel.outputs import write_output

CHECKPOINT = "checkpoint.pt"


@dataclass(frozen=True)
class Checkpoint:
    """The state of a training before `step`.

    Attributes:
      key: digest of all that decides the result (configuration, robot, data, first weights).
      step: next step to be done.
      weights: of the network.
      optimiser: AdamW's state.
      averaged: state of the averaged weights.
      best: weights with the least selection error so far; empty before the first validation.
      best_error: that error.
      best_step: steps done when they were validated.
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
    """Read the checkpoint of a folder; None where there is none.

    Raises:
      ConfigError: it belongs to a training with another configuration, robot, data or first
        weights.
      DataError: it is damaged.
    """
    path = folder / CHECKPOINT
    if not path.exists():
        return None
    try:
        fields = torch.load(path, map_location=device, weights_only=True)
        checkpoint = Checkpoint(**fields)
    except (RuntimeError, TypeError, EOFError, OSError, pickle.UnpicklingError) as error:
        raise DataError(
            f"{path} is damaged ({error}); remove it to train again from the start."
        ) from None
    if checkpoint.key != key:
        raise ConfigError(
            f"{path} belongs to a training with another configuration, robot, data or "
            f"first weights ({checkpoint.key[:12]}, this one is {key[:12]}); use another folder."
        )
    return checkpoint
