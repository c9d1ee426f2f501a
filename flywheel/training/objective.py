"""The objective of a training step: its windows, and the network's loss on them."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from flywheel.data import WindowCache
from flywheel.dynamics.gnn import Batch, ChunkNetwork, Simulator
from flywheel.records import RECORDING
from flywheel.robots import symmetries_of
from flywheel.training.batches import Draw, generator, noisy, relabelled, to_batch, turned
from flywheel.training.config import Schedule, TrainingConfig
from flywheel.training.helper import Helper
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
        self._tethered = simulator.robot.tethered
        self._scales = self._measured_scales().to(config.device)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_cache": None, "_draws": {}}  # a helper is sent its windows

    def helpers(self, network: ChunkNetwork) -> list[Helper]:
        """One for each part of a batch but the last. A GPU has none: it would do the work of all."""
        count = self._config.processes - 1 if self._config.device == "cpu" else 0
        return [Helper(self.part, network, self.batch(0)[:1], 1.0) for _ in range(count)]

    def backward(self, network: ChunkNetwork, step: int, helpers: Sequence[Helper] = ()) -> Losses:
        """Losses of one optimiser step's batch; their gradient is left in the weights' `grad`.

        The batch is cut into `processes` parts. Their sum is taken in a fixed order, whoever computes
        them: `helpers` the first ones, at the same time as this process the others.
        """
        batch = self.batch(step)
        pieces = [batch[rows] for rows in _cut(len(batch.points), self._config.processes)]
        work = [(piece, len(piece.points) / len(batch.points)) for piece in pieces]
        begun = [each.begin(network, *some) for each, some in zip(helpers, work, strict=False)]
        own = [self.part(network, *some) for some in work[len(begun) :]]
        parts = [*(result() for result in begun), *own]
        for weight, *gradients in zip(_weights(network), *(part[1] for part in parts), strict=True):
            present = [gradient for gradient in gradients if gradient is not None]
            weight.grad = functools.reduce(torch.add, present) if present else None
        return functools.reduce(Losses.__add__, (losses for losses, _ in parts))

    def part(
        self, network: ChunkNetwork, batch: Batch, share: float
    ) -> tuple[Losses, tuple[Tensor | None, ...]]:
        """Losses of a part of a batch, times its share, and their gradient by the trained weights."""
        losses = self.loss(network, batch).times(share)
        gradient = torch.autograd.grad(losses.total, _weights(network), allow_unused=True)
        return losses.detached(), gradient

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
        if config.yaw_augmentation and not (self._simulator.config.yaw_frame or self._tethered):
            gathered = turned(gathered, rng)
        if self._symmetries is not None:
            alike = self._simulated[gathered.dataset]
            gathered = relabelled(gathered, self._symmetries, alike, rng)
        if config.noise > 0:
            gathered = noisy(
                gathered, self._history, config.noise * self._simulator.robot.length, rng
            )
        return to_batch(gathered, self._history, config.device, self._tethered)

    def measured(self) -> Batch:
        """A large batch of unmodified one-chunk windows, to measure scales on."""
        rng = generator(self._config.seed, 0, _MEASURING)
        starts = self._draws[min(self._draws)](rng, _MEASURED_WINDOWS)
        windows = self._cache.gather(starts, self._history + self._chunk)
        return to_batch(windows, self._history, tethered=self._tethered)

    def _measured_scales(self) -> LossScales:
        batch = self.measured()
        return residual_scales(
            self._simulator.node_positions(batch.points),
            torch.cat([batch.past_winch[:, -1:], batch.winch], dim=1),
            self._simulator.dt,
        )


def _weights(network: ChunkNetwork) -> list[Tensor]:
    return [weight for weight in network.parameters() if weight.requires_grad]


def _cut(length: int, parts: int) -> list[slice]:
    """At most `parts` slices of nearly equal length that together are 0..length."""
    parts = min(parts, length)
    edges = [length * i // parts for i in range(parts + 1)]
    return [slice(low, high) for low, high in itertools.pairwise(edges)]
