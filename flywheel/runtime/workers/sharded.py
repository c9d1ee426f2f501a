"""A learned model whose rollouts are shared out over other workers."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from flywheel.dynamics.gnn import LearnedDynamics
from flywheel.records import Floats, Past, Rollout
from flywheel.robots import Robot

Ask = Callable[[Sequence[tuple[Past, Floats]]], Sequence[tuple[Floats, Floats] | None]]


class ShardedDynamics:
    """Predicts with the help of others; answers `flywheel.dynamics.protocol.Dynamics`.

    Shares are the model's own blocks, so that a prediction is the same to the bit whoever makes it.

    Args:
      local: the model; predicts whatever a helper fails to.
      ask: predicts (past, controls (b, H, W)) pairs elsewhere, all at once; points (b, H + 1, P, 3) and
        winch (b, H + 1, W) of each, or None where a helper is gone.
    """

    def __init__(self, local: LearnedDynamics, ask: Ask) -> None:
        self._local, self._ask = local, ask

    @property
    def robot(self) -> Robot:
        """Of the model."""
        return self._local.robot

    @property
    def dt(self) -> float:
        """Of the model [s]."""
        return self._local.dt

    @property
    def history(self) -> int:
        """Of the model."""
        return self._local.history

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls` (B, H, W).

        Raises:
          ModelError: as the model itself.
        """
        past = dataclasses.replace(past, state=None)  # the model does not look at it
        one = len(past.controls) == 1
        blocks = self._local.blocks(len(controls))
        parts = [(past if one else _rows(past, rows), controls[rows]) for rows in blocks]
        found = [
            self._predicted(*part) if answer is None else answer
            for part, answer in zip(parts, self._ask(parts), strict=True)
        ]
        points, winch = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
        return Rollout(points, winch)

    def _predicted(self, past: Past, controls: Floats) -> tuple[Floats, Floats]:
        rollout = self._local.rollout(past, controls)
        return rollout.points, rollout.winch


def _rows(past: Past, rows: slice) -> Past:
    return dataclasses.replace(
        past,
        observations=past.observations[rows],
        controls=past.controls[rows],
        winch=past.winch[rows],
        terrains=past.terrains_at(rows),
    )


class Helpers:
    """Workers that predict for others. Sent to a worker together with its job.

    Args:
      colleagues: that can be asked.
      weights: of the model, as shared by the pool.
    """

    def __init__(self, colleagues: Any, weights: Any) -> None:
        self._colleagues, self._weights = colleagues, weights

    def ask(self, parts: Sequence[tuple[Past, Floats]]) -> Sequence[tuple[Floats, Floats] | None]:
        """Predict all parts at once; see `ShardedDynamics`."""
        calls = [(self._weights, past, controls) for past, controls in parts]
        return self._colleagues.ask("rollout", calls)
