"""A trained network as a dynamics model."""

from __future__ import annotations

import copy
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.arithmetic import Device, Precision
from flywheel.dynamics.gnn.devices import check_device
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.dynamics.gnn.simulator import Simulator, Start
from flywheel.dynamics.gnn.weights import weights_digest
from flywheel.dynamics.rigid_bodies.ground import ground_of
from flywheel.dynamics.threads import one_thread_per_operation, shares
from flywheel.errors import ModelError
from flywheel.records import Floats, Past, Rollout
from flywheel.robots import Robot

BLOCK = 256


class LearnedDynamics:
    """Predicts with a network; implements `flywheel.dynamics.protocol.Dynamics`.

    The batch is computed in blocks of equal size, small enough that a block's arrays stay in the
    processor's cache. Each block runs on one thread; `threads` of them run in parallel. The
    assignment of candidates to blocks changes predictions by rounding only (about 1e-6 relative).
    A GPU computes the whole batch at once.

    Args:
      robot: the robot.
      network: its weights; copied, later changes have no effect.
      threads: Python threads that share the batch, block by block.
      block: largest number of candidates computed at a time.
      precision: of its matrix products, on the processor.
      device: of the computation; "cuda" for a GPU, where `threads` and `block` have no effect.

    Raises:
      ModelError: the network was made for another robot.
      ConfigError: there is no such device.
    """

    def __init__(
        self,
        robot: Robot,
        network: ChunkNetwork,
        threads: int = 1,
        block: int = BLOCK,
        precision: Precision = "float32",
        device: Device = "cpu",
    ) -> None:
        check_device(device)
        self.robot, self.dt, self.history = robot, network.config.dt, network.config.history
        self.digest = weights_digest(network)
        self._simulator = Simulator(robot, network.config, precision=precision)
        network = copy.deepcopy(network).requires_grad_(False).to(device)
        self._forward = self._simulator.prepare(network, device)
        self._threads, self._block = (threads, block) if device == "cpu" else (1, sys.maxsize)
        self._device = device

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(self._threads, "learned", torch.set_num_threads, (1,))

    def blocks(self, batch: int) -> list[slice]:
        """Slices of the batch; each block may be predicted by another model of the kind."""
        return shares(batch, self._block, self._threads)

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls` (B, H, W).

        Raises:
          ModelError: shapes do not fit the robot, the data set is unknown to the network, a point
            is missing in the whole past, or the prediction is not finite.
        """
        past = past.latest(self.history, self.robot.holding(past.winch[:, 0]))
        seen, batch = past.observations.points, len(controls)
        self._simulator.check(seen, past.controls, past.winch, controls)
        self._check_data_set(past.dataset)
        with one_thread_per_operation():
            shared = self._start(past, slice(None)) if len(seen) == 1 else None
            blocks = self.blocks(batch)
            run = partial(self._run, past, controls, shared)
            alone = self._threads == 1 or len(blocks) == 1
            parts = list(map(run, blocks) if alone else self._pool.map(run, blocks))
        points, winch = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        if not (np.isfinite(points).all() and np.isfinite(winch).all()):
            raise ModelError(self._not_finite(points, winch))
        return Rollout(points, winch)

    def _start(self, past: Past, rows: slice) -> Start:
        return self._simulator.start(
            self._tensor(past.observations.points[rows]),
            self._tensor(past.controls[rows]),
            self._tensor(past.winch[rows]),
            ground_of(past.terrains_at(rows), self._device),
        )

    def _tensor(self, array: Floats) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self._device)

    @torch.inference_mode()
    def _run(
        self, past: Past, controls: Floats, shared: Start | None, rows: slice
    ) -> tuple[Floats, Floats]:
        """Points (b, H + 1, P, 3) and winch (b, H + 1, W) of one block, from the present on."""
        start = shared or self._start(past, rows)
        commands = self._tensor(controls[rows])
        dataset = torch.tensor([past.dataset], device=self._device)
        unrolled = self._simulator.roll(self._forward, start, commands, dataset)
        points, winch = (
            torch.cat([now.expand(len(commands), *now.shape[1:])[:, None], ahead], dim=1)
            for now, ahead in zip(
                self._simulator.present(start), (unrolled.points, unrolled.winch), strict=True
            )
        )
        return points.double().cpu().numpy(), winch.double().cpu().numpy()

    def _check_data_set(self, dataset: int) -> None:
        known = self._simulator.config.datasets
        if not 0 <= dataset < known:
            raise ModelError(
                f"The network distinguishes {known} data sets, numbers 0 to {known - 1}; got "
                f"{dataset}."
            )

    def _not_finite(self, points: Floats, winch: Floats) -> str:
        wrong = ~np.isfinite(points).all(axis=(2, 3)) | ~np.isfinite(winch).all(axis=2)
        candidate, step = np.argwhere(wrong)[0]
        count = len(np.unique(np.argwhere(wrong)[:, 0]))
        return (
            f"The network {self.digest[:12]} predicts a non-finite number for candidate "
            f"{candidate} from {step * self.dt:.2f} s on ({count} of {len(points)} candidates)."
        )
