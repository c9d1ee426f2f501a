"""Validation: rollouts of the network from fixed windows of held-out episodes.

Weights are selected by this, never by the training loss: over one chunk the loss falls while
rollouts get worse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from flywheel.data import WindowCache
from flywheel.dynamics.gnn import ChunkNetwork, Simulator
from flywheel.errors import DataError
from flywheel.evaluation import ErrorTable
from flywheel.evaluation.statistics import rotation_error, shows_turn, squared_position_error
from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.training.batches import generator, to_batch

_BLOCK = 64  # windows rolled out at a time, so that a block's activations stay in the cache
_FAR = 1e3  # [m] where a rollout that is not finite is taken to have gone
_PURPOSE = 3


@dataclass(frozen=True)
class ValidationErrors:
    """A network's errors on the validation windows.

    Attributes:
      table: over all of them.
      by_window: (windows,) selection criterion of each window, see `selection_error`.
    """

    table: ErrorTable
    by_window: Floats


def selection_error(errors: ValidationErrors) -> float:
    """Selection criterion: rotation error [deg] plus the mean RMSE/L of a window [%].

    For a robot with one tracked point per body it is the latter alone.

    Both have the same size for a good model, and neither can be traded for the other. The root over
    all windows together is unsuitable: it is dominated by the few in which a robot tips over the
    other way. Infinite if an error is not a number.
    """
    error = float(np.nanmean(errors.by_window))
    return error if math.isfinite(error) else math.inf


def clearly_worse(after: ValidationErrors, before: ValidationErrors) -> bool:
    """True if weights are worse than others on the same windows by more than two standard errors."""
    if not math.isfinite(selection_error(after)):
        return True
    more = after.by_window - before.by_window
    more = more[np.isfinite(more)]
    return bool(more.mean() > 2.0 * more.std() / math.sqrt(len(more))) if len(more) else False


class Validation:
    """Fixed windows, drawn once by the seed, and the network's errors on them.

    Args:
      robot: of the episodes.
      cache: of the validation episodes.
      history, chunk: of the network [steps].
      dt: control step [s].
      seconds: predicted per window [s].
      windows: their number.
      seed: of the draw.

    Raises:
      DataError: no episode is long enough for one window.
    """

    def __init__(
        self,
        robot: Robot,
        cache: WindowCache,
        *,
        history: int,
        chunk: int,
        dt: float,
        seconds: float,
        windows: int,
        seed: int,
    ) -> None:
        self._robot, self._dt, self._history = robot, dt, history
        steps = max(1, round(seconds / dt))
        length = history + steps
        starts = cache.starts(length, past=history)
        if len(starts) == 0:
            raise DataError(
                f"No validation episode has a window of {length} steps (history {history} and "
                f"{seconds} s to predict) in whose past every point was seen; give longer episodes or "
                "a shorter validation_seconds."
            )
        rng = generator(seed, 0, _PURPOSE)
        chosen = np.sort(rng.choice(starts, min(windows, len(starts)), replace=False))
        gathered = cache.gather(chosen, length)
        self._steps, self._chunks = steps, math.ceil(steps / chunk)
        self._batch = to_batch(gathered, history, tethered=robot.tethered)
        self._chunk = chunk

    @torch.no_grad()
    def __call__(
        self, simulator: Simulator, network: ChunkNetwork, device: str
    ) -> ValidationErrors:
        """Errors of the network's rollouts; a non-finite rollout counts as far off."""
        table, by_window = ErrorTable.empty(self._robot, self._dt), []
        for i in range(0, len(self._batch.points), _BLOCK):
            truth, predicted = self._block(simulator, network, device, slice(i, i + _BLOCK))
            table = table + ErrorTable.between(self._robot, self._dt, truth, predicted)
            squares = squared_position_error(self._robot, truth, predicted)
            place = 100.0 * np.sqrt(np.nanmean(squares, axis=(1, 2))) / self._robot.length
            by_window.append(place + self._turn(truth, predicted))
        return ValidationErrors(table, np.concatenate(by_window))

    def _turn(self, truth: Floats, predicted: Floats) -> Floats | float:
        """(B,) mean rotation errors [deg]; 0 for a robot whose points show none."""
        if not any(shows_turn(self._robot, body) for body in self._robot.bodies):
            return 0.0
        return np.asarray(np.nanmean(rotation_error(self._robot, truth, predicted), axis=(1, 2)))

    def _block(
        self, simulator: Simulator, network: ChunkNetwork, device: str, rows: slice
    ) -> tuple[Floats, Floats]:
        """True and predicted points (B, T, P, 3) of some windows [m]."""
        batch = self._batch[rows].to(device)
        controls = batch.controls
        missing = self._chunks * self._chunk - self._steps
        controls = torch.cat([controls, controls[:, -1:].repeat(1, missing, 1)], dim=1)
        unrolled = simulator.unroll(
            network,
            batch.past_points,
            batch.past_controls,
            batch.past_winch,
            controls,
            batch.dataset,
            batch.ground,
        )
        predicted = unrolled.points[:, : self._steps].double().cpu().numpy()
        predicted = np.clip(np.nan_to_num(predicted, nan=_FAR), -_FAR, _FAR)
        return batch.points[:, 2:].double().cpu().numpy(), predicted
