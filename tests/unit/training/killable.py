"""A training in a process of its own, to be killed by a test. Prints a line per step."""

import sys
from pathlib import Path

from flywheel.dynamics.gnn import NetworkConfig
from flywheel.robots import load_robot
from flywheel.training import Trainer, TrainingConfig
from tests.unit.training.memory_cache import MemoryCache


def main(folder: Path) -> None:
    Trainer(
        TrainingConfig.model_validate_json((folder / "training.json").read_text()),
        NetworkConfig.model_validate_json((folder / "network.json").read_text()),
        load_robot("prism3"),
        MemoryCache.load(folder / "train.npz"),
        MemoryCache.load(folder / "validation.npz"),
        folder / "run",
    ).run(lambda progress: print(progress.point.step, flush=True))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
