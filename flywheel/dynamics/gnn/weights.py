"""Weights in a file: arrays without pickle, and a readable side file that says what they are."""

from __future__ import annotations

from pathlib import Path

from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.robots import Robot


def save_weights(network: ChunkNetwork, path: Path | str, snapshot: str = "") -> str:
    """Write weights to `path` (.npz) and what they are beside it (.json); return their digest.

    Args:
      network: to be saved.
      path: of the .npz file.
      snapshot: digest of the data set they were trained on.
    """
    raise NotImplementedError


def load_weights(path: Path | str, robot: Robot) -> ChunkNetwork:
    """Read weights written by `save_weights`.

    Raises:
      ModelError: no such weights, damaged ones, or ones for another robot.
    """
    raise NotImplementedError


def weights_digest(network: ChunkNetwork) -> str:
    """Sha256 of config, robot and every array; the same for the same weights whenever written."""
    raise NotImplementedError
