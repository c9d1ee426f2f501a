"""The objective of a training step: its windows, and the network's loss on them."""

from __future__ import annotations

import functools
import itertools
from concurrent.futures import Executor

import numpy as np
import torch
from torch import Tensor

from flywheel.data import WindowCache
from flywheel.dynamics.gnn import Batch, ChunkNetwork, Simulator
from flywheel.records import RECORDING
from flywheel.robots import symmetries_of
from flywheel.training.batches import Draw, generator, noisy, relabelled, to_batch, turned
from flywheel.training.config import Schedule, TrainingConfig
from flywheel.training.loss import Losses, LossScales, Truth, residual_scales, window_loss
from flywheel.training.schedules import stage_at

_ORDER, _AUGMENTATION, _MEASURING = 0, 1, 2  # purposes of random numbers
_MEASURED_WINDOWS = 4096


class Objective:
    """The loss of each step, as a pure function of the weights and (seed, step).

    Args:
      config: recipe.
      schedule: determines the length of the windows of a step.
      simulator: of the network.
      cache: windows of the training episodes.

    Raises:
      DataError: no episode is as long as a window.
      ConfigError: `mix` names an unknown data set.
    """

    def __init__(
        self, config: TrainingConfig, schedule: Schedule, simulator: Simulator, cache: WindowCache
    ) -> None:
        self._config, self._schedule = config, schedule
        self._simulator, self._cache = simulator, cache
        self._history, self._chunk = simulator.config.history, simulator.config.chunk
        self._draws = {
            chunks: Draw(cache, self._history + chunks * self._chunk, self._history, config.mix)
            for chunks in sorted({stage.chunks for stage in schedule.stages})
        }
        self._simulated = np.array([name != RECORDING for name in cache.datasets])
        self._symmetries = symmetries_of(simulator.robot) if config.symmetries else None
        self._scales = self._measured_scales().to(config.device)

    def backward(self, network: ChunkNetwork, step: int, pool: Executor | None = None) -> Losses:
        """Losses of one optimiser step's batch; their gradient is left in the weights' `grad`.

        The batch is cut into `threads` parts, which `pool` computes at the same time. Their sum is
        taken in a fixed order, independent of their completion.
        """
        batch = self.batch(step)
        weights = [w for w in network.parameters() if w.requires_grad]

        def part(rows: slice) -> tuple[Losses, tuple[Tensor | None, ...]]:
            piece = batch[rows]
            losses = self.loss(network, piece).times(len(piece.points) / len(batch.points))
            return losses.detached(), torch.autograd.grad(losses.total, weights, allow_unused=True)

        rows = _cut(len(batch.points), self._config.threads)
        parts = list((pool.map if pool else map)(part, rows))
        for weight, *pieces in zip(weights, *(gradients for _, gradients in parts), strict=True):
            present = [piece for piece in pieces if piece is not None]
            weight.grad = functools.reduce(torch.add, present) if present else None
        return functools.reduce(Losses.__add__, (losses for losses, _ in parts))

    def loss(self, network: ChunkNetwork, batch: Batch) -> Losses:
        """Losses of a batch, averaged over its windows."""
        predicted = self._simulator.unroll(
            network,
            batch.past_points,
            batch.past_controls,
            batch.past_winch,
            batch.controls,
            batch.dataset,
            batch.ground,
        )
        nodes = self._simulator.node_positions(batch.points[:, 1:])
        truth = Truth(nodes[:, 1:], nodes.diff(dim=1) / self._simulator.dt, batch.winch)
        return window_loss(
            predicted.node_positions,
            predicted.velocities,
            predicted.winch,
            truth,
            self._scales,
            self._config,
        )

    def batch(self, step: int) -> Batch:
        """The windows of one optimiser step, augmented."""
        config = self._config
        chunks = stage_at(self._schedule, step).chunks
        windows = max(config.least_windows, config.chunks_per_batch // chunks)
        starts = self._draws[chunks](generator(config.seed, step, _ORDER), windows)
        gathered = self._cache.gather(starts, self._history + chunks * self._chunk)
        rng = generator(config.seed, step, _AUGMENTATION)
        if config.yaw_augmentation and not self._simulator.config.yaw_frame:
            gathered = turned(gathered, rng)
        if self._symmetries is not None:
            alike = self._simulated[gathered.dataset]
            gathered = relabelled(gathered, self._symmetries, alike, rng)
        if config.noise > 0:
            gathered = noisy(
                gathered, self._history, config.noise * self._simulator.robot.length, rng
            )
        return to_batch(gathered, self._history, config.device)

    def measured(self) -> Batch:
        """A large batch of unmodified one-chunk windows, to measure scales on."""
        rng = generator(self._config.seed, 0, _MEASURING)
        starts = self._draws[min(self._draws)](rng, _MEASURED_WINDOWS)
        return to_batch(self._cache.gather(starts, self._history + self._chunk), self._history)

    def _measured_scales(self) -> LossScales:
        batch = self.measured()
        return residual_scales(
            self._simulator.node_positions(batch.points),
            torch.cat([batch.past_winch[:, -1:], batch.winch], dim=1),
            self._simulator.dt,
        )


def _cut(length: int, parts: int) -> list[slice]:
    """At most `parts` slices of nearly equal length that together are 0..length."""
    parts = min(parts, length)
    edges = [length * i // parts for i in range(parts + 1)]
    return [slice(low, high) for low, high in itertools.pairwise(edges)]
