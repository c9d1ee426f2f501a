"""Validation: rolling the network out from fixed windows of episodes it is not trained on.

Weights are selected by this, never by the training loss: over one chunk the loss falls while
rollouts get worse.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from flywheel.data import WindowCache
from flywheel.dynamics.gnn import ChunkNetwork, Simulator
from flywheel.errors import DataError
from flywheel.evaluation import ErrorTable
from flywheel.robots import Robot
from flywheel.training.batches import generator, to_batch

SELECTION = "e_rot [deg] + e_pos_rmse [%]"
_BLOCK = 64  # windows rolled out at a time, so that a block's activations stay in the cache
_FAR = 1e3  # [m] where a rollout that is not finite is taken to have gone
_PURPOSE = 3


def selection_error(table: ErrorTable) -> float:
    """What the best weights have least of: rotation error [deg] plus position error as RMSE/L [%].

    Both are of the same size for a good model, and neither can be bought with the other. Infinite
    where an error is not a number.
    """
    error = table.e_rot + table.e_pos_rmse
    return error if math.isfinite(error) else math.inf


class Validation:
    """Fixed windows, drawn once by the seed, and the network's errors on them.

    Args:
      robot: of the episodes.
      cache: of the validation episodes.
      history, chunk: of the network [steps].
      dt: control step [s].
      seconds: predicted per window [s].
      windows: how many.
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
        self._batch = to_batch(gathered, history)
        self._chunk = chunk

    @torch.no_grad()
    def __call__(self, simulator: Simulator, network: ChunkNetwork, device: str) -> ErrorTable:
        """Errors of the network's rollouts; a rollout that is not finite counts as far off."""
        table = ErrorTable.empty(self._robot, self._dt)
        for i in range(0, len(self._batch.points), _BLOCK):
            table = table + self._block(simulator, network, device, slice(i, i + _BLOCK))
        return table

    def _block(
        self, simulator: Simulator, network: ChunkNetwork, device: str, rows: slice
    ) -> ErrorTable:
        batch = self._batch
        controls = batch.controls[rows]
        missing = self._chunks * self._chunk - self._steps
        controls = torch.cat([controls, controls[:, -1:].repeat(1, missing, 1)], dim=1)
        unrolled = simulator.unroll(
            network,
            batch.past_points[rows].to(device),
            batch.past_controls[rows].to(device),
            batch.past_winch[rows].to(device),
            controls.to(device),
            batch.dataset[rows].to(device),
        )
        predicted = unrolled.points[:, : self._steps].double().cpu().numpy()
        predicted = np.clip(np.nan_to_num(predicted, nan=_FAR), -_FAR, _FAR)
        truth = batch.points[rows, 1:].double().numpy()
        return ErrorTable.between(self._robot, self._dt, truth, predicted)
