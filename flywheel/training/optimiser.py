"""The optimiser of a network: Muon on its hidden matrices, AdamW on all other weights."""

from __future__ import annotations

from typing import Any

import torch
from torch.optim import AdamW, Muon

from flywheel.dynamics.gnn import ChunkNetwork
from flywheel.training.config import TrainingConfig


class NetworkOptimiser:
    """Steps the weights of a network by their gradients.

    Args:
      network: the weights.
      config: `matrix_rate` and `weight_decay`.
    """

    def __init__(self, network: ChunkNetwork, config: TrainingConfig) -> None:
        decay, matrices = config.weight_decay, network.hidden_matrices()
        inside = {id(weight) for weight in matrices} if config.matrix_rate else set()
        others = [weight for weight in network.parameters() if id(weight) not in inside]
        self._parts: list[tuple[float, torch.optim.Optimizer]] = [
            (1.0, AdamW(others, 1.0, weight_decay=decay))
        ]
        if config.matrix_rate:
            muon = Muon(matrices, 1.0, weight_decay=decay, adjust_lr_fn="match_rms_adamw")
            self._parts.append((config.matrix_rate, muon))

    def step(self, rate: float) -> None:
        """Change the weights by one step at a learning rate."""
        for factor, optimiser in self._parts:
            for group in optimiser.param_groups:
                group["lr"] = factor * rate
            optimiser.step()

    def state_dict(self) -> dict[str, Any]:
        """The state, for a checkpoint."""
        return {"parts": [optimiser.state_dict() for _, optimiser in self._parts]}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from a state."""
        for (_, optimiser), kept in zip(self._parts, state["parts"], strict=True):
            optimiser.load_state_dict(kept)
