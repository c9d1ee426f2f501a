"""Training batches: the windows of a step, with rotations, symmetries and shifts."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from flywheel.data import WindowBatch, WindowCache
from flywheel.dynamics.gnn import Batch, View
from flywheel.errors import ConfigError, DataError
from flywheel.records import Floats
from flywheel.robots import Symmetries


def generator(seed: int, step: int, purpose: int) -> np.random.Generator:
    """Random numbers of one step: a pure function of its arguments."""
    return np.random.default_rng([seed, step, purpose])


class Draw:
    """The windows of a cache for each training step.

    Args:
      cache: of the training episodes.
      length: control steps per window.
      past: number of first steps from which the rest is predicted.
      mix: fraction of each data set by name; empty draws all windows alike.

    Raises:
      DataError: no episode is as long as a window, or every past misses a point.
      ConfigError: `mix` names a data set without windows.
    """

    def __init__(
        self, cache: WindowCache, length: int, past: int, mix: Mapping[str, float]
    ) -> None:
        starts = cache.starts(length, past=past)
        if len(starts) == 0:
            raise DataError(
                f"No training episode has a window of {length} steps in whose past every point was "
                "seen; record longer episodes, or train on fewer prediction chunks per window."
            )
        self._groups = _by_dataset(cache, starts, mix) if mix else [(1.0, starts)]

    def __call__(self, rng: np.random.Generator, windows: int) -> NDArray[np.int64]:
        """Draw the starts of `windows` windows."""
        shares = np.array([share for share, _ in self._groups])
        counts = rng.multinomial(windows, shares / shares.sum())
        return np.concatenate(
            [rng.choice(starts, n) for n, (_, starts) in zip(counts, self._groups, strict=True)]
        )


def to_batch(
    windows: WindowBatch, history: int, device: str = "cpu", tethered: bool = False
) -> Batch:
    """Split windows at their present and shift each so that its robot stands above the origin.

    Args:
      windows: gathered.
      history: of the network [steps].
      device: of the batch.
      tethered: cables hold the robot in the world (`Robot.tethered`): its windows stay where they are.
    """
    shift = _ground_center(windows.points[:, history]) * (not tethered)
    past, ahead = (
        points - shift[:, None, None]
        for points in (windows.points[:, : history + 1], windows.points_truth[:, history - 1 :])
    )
    angle = np.broadcast_to(windows.angle, len(past))
    return Batch(
        past_points=_tensor(past, device),
        past_controls=_tensor(windows.controls[:, :history], device),
        past_winch=_tensor(windows.winch[:, : history + 1], device),
        controls=_tensor(windows.controls[:, history:], device),
        points=_tensor(ahead, device),
        winch=_tensor(windows.winch_truth[:, history + 1 :], device),
        dataset=torch.as_tensor(np.asarray(windows.dataset), dtype=torch.int64, device=device),
        terrains=windows.terrains,
        view=View(_tensor(angle, device), _tensor(shift[:, :2].T, device)),
    )


def turned(windows: WindowBatch, rng: np.random.Generator) -> WindowBatch:
    """The same windows, each turned about the vertical by a random angle."""
    angle = rng.uniform(0.0, 2.0 * np.pi, len(windows.points))
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0] = np.sin(angle)
    turn[:, 0, 1] = -turn[:, 1, 0]
    turn[:, 2, 2] = 1.0
    points, truth = (
        np.einsum("bij,btpj->btpi", turn, each) for each in (windows.points, windows.points_truth)
    )
    return dataclasses.replace(
        windows, points=points, points_truth=truth, angle=windows.angle + angle
    )


def relabelled(
    windows: WindowBatch,
    symmetries: Symmetries,
    which: NDArray[np.bool_],
    rng: np.random.Generator,
) -> WindowBatch:
    """The same windows, those of (B,) `which` with the parts listed in the order of a random symmetry."""
    drawn = np.where(which, rng.integers(len(symmetries.points), size=len(which)), 0)
    points, winches = symmetries.points[drawn, None, :, None], symmetries.winches[drawn, None]
    seen, true = (np.take_along_axis(e, points, 2) for e in (windows.points, windows.points_truth))
    controls, winch, winch_truth = (
        np.take_along_axis(each, winches, 2)
        for each in (windows.controls, windows.winch, windows.winch_truth)
    )
    return dataclasses.replace(
        windows,
        points=seen,
        points_truth=true,
        controls=controls,
        winch=winch,
        winch_truth=winch_truth,
    )


def noisy(
    windows: WindowBatch, history: int, deviation: float, rng: np.random.Generator
) -> WindowBatch:
    """The same windows with white noise [m] on the past's points; targets are unchanged."""
    points = np.array(windows.points)
    past = points[:, : history + 1]
    past += deviation * rng.standard_normal(past.shape)
    return dataclasses.replace(windows, points=points)


def _ground_center(points: Floats) -> Floats:
    """(B, 3) mean of the present points, at height 0."""
    present = np.isfinite(points).all(axis=-1, keepdims=True)
    center = np.where(present, points, 0.0).sum(axis=1) / np.maximum(present.sum(axis=1), 1)
    return center * np.array([1.0, 1.0, 0.0])


def _by_dataset(
    cache: WindowCache, starts: NDArray[np.int64], mix: Mapping[str, float]
) -> list[tuple[float, NDArray[np.int64]]]:
    index = cache.gather(starts, 0).dataset
    groups = []
    for name, share in mix.items():
        known = cache.datasets
        found = starts[index == known.index(name)] if name in known else starts[:0]
        if share > 0 and len(found) == 0:
            raise ConfigError(
                f"mix gives data set {name!r} a share of {share}, but it has no training window. "
                f"There are: {', '.join(known)}."
            )
        groups.append((share, found))
    return groups


def _tensor(array: Floats, device: str) -> Tensor:
    return torch.as_tensor(np.ascontiguousarray(array, np.float32), device=device)
