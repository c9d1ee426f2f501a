"""Content of a run of the smallest configuration, in digests and numbers."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np


def of_run(folder: Path) -> dict[str, Any]:
    """Digests of every stored array and of every network, and the numbers of every iteration."""
    arrays = {
        f"{zarr.parent.name}/{array.name}": _digest(array)
        for zarr in sorted(folder.glob("store/segments/*/*.zarr"))
        for array in sorted(zarr.iterdir())
        if array.is_dir()
    }
    weights = {
        file.parent.name: _weights(file) for file in sorted(folder.glob("models/*/weights.npz"))
    }
    iterations = {
        file.stem: json.loads(file.read_text()) for file in sorted(folder.glob("iterations/*.json"))
    }
    return {"arrays": arrays, "weights": weights, "iterations": iterations}


def _digest(array: Path) -> str:
    """SHA-256 of the chunks of a Zarr array, without its metadata."""
    chunks = sorted(p for p in array.rglob("*") if p.is_file() and p.name != "zarr.json")
    return hashlib.sha256(b"".join(p.read_bytes() for p in chunks)).hexdigest()


def _weights(file: Path) -> str:
    with np.load(file) as held:
        parts = [name.encode() + held[name].tobytes() for name in sorted(held.files)]
    return hashlib.sha256(b"".join(parts)).hexdigest()
