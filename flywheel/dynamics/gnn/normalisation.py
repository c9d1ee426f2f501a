"""Measuring, on training data, the scales that the network's inputs and outputs are divided by."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from torch import Tensor

from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.dynamics.gnn.simulator import Simulator


class Windows(Protocol):
    """Windows of measured data, split at their present (`flywheel.training.batches.Batch`)."""

    past_points: Tensor
    past_controls: Tensor
    past_winch: Tensor
    controls: Tensor
    points: Tensor
    winch: Tensor
    dataset: Tensor


def fit_normalisation(
    simulator: Simulator, network: ChunkNetwork, batches: Iterable[Windows]
) -> None:
    """Set the network's normalisation from training windows of at least one prediction chunk.

    Args:
      simulator: of the network's robot.
      network: whose buffers are set.
      batches: training windows with past_points (B, h + 1, P, 3), past_controls (B, h, W), past_winch
        (B, h + 1, W), controls (B, S, W), points (B, S + 1, P, 3) from the present on, winch (B, S, W)
        and dataset (B,); S >= n. NaN where missing.
    """
    raise NotImplementedError
