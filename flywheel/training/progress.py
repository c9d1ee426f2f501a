"""Progress reports of a training, and its result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class CurvePoint:
    """One point of the training curve, without timings, so that it is reproducible.

    Attributes:
      step: optimiser steps done.
      chunks: prediction chunks per window at this step.
      learning_rate: at this step.
      loss, velocity, position, rest: training loss and its parts on this step's batch.
      e_pos_mse, e_pos_rmse: [%] validation rollout errors, None without a validation.
      e_rot: [deg] likewise.
      error: selection error, likewise.
    """

    step: int
    chunks: int
    learning_rate: float
    loss: float
    velocity: float
    position: float
    rest: float
    e_pos_mse: float | None = None
    e_pos_rmse: float | None = None
    e_rot: float | None = None
    error: float | None = None


@dataclass(frozen=True)
class TrainingProgress:
    """Progress of a training.

    Attributes:
      point: the newest point of the curve.
      steps: of the whole budget.
      steps_per_second: since this process began training [1/s].
      best_error: least selection error so far; infinite before the first validation.
    """

    point: CurvePoint
    steps: int
    steps_per_second: float
    best_error: float


@dataclass(frozen=True)
class TrainingResult:
    """A finished training.

    Attributes:
      weights: file of the best weights.
      digest: sha256 of them.
      best_error: of the best weights: e_rot [deg] and mean RMSE/L of a window [%], added.
      best_step: optimiser steps done at that time; 0: the initial weights were never improved.
      steps: optimiser steps done.
      curve: one point every `report_every` steps and at each validation.
    """

    weights: Path
    digest: str
    best_error: float
    best_step: int
    steps: int
    curve: tuple[CurvePoint, ...]


OnProgress = Callable[[TrainingProgress], None]
