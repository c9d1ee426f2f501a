from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flywheel.data import WindowBatch

ARRAYS = ("points", "controls", "winch", "dataset")


@dataclass
class MemoryCache:
    """Windows of episodes held in memory; answers what training asks of a `WindowCache`."""

    points: np.ndarray
    controls: np.ndarray
    winch: np.ndarray
    dataset: np.ndarray
    datasets: tuple[str, ...] = ("nominal",)
    digest: str = "0" * 64
    belief: str = ""

    def starts(self, length: int, past: int | None = None) -> np.ndarray:
        episodes, steps = self.controls.shape[:2]
        first = np.arange(max(0, steps - length + 1))
        return (np.arange(episodes)[:, None] * (steps + 1) + first).ravel().astype(np.int64)

    def gather(self, starts: np.ndarray, length: int) -> WindowBatch:
        steps = self.controls.shape[1]
        episode, first = np.divmod(np.asarray(starts), steps + 1)
        rows = first[:, None] + np.arange(length + 1)
        return WindowBatch(
            self.points[episode[:, None], rows],
            self.points[episode[:, None], rows],
            self.controls[episode[:, None], rows[:, :-1]],
            self.winch[episode[:, None], rows],
            self.winch[episode[:, None], rows],
            self.dataset[episode],
        )

    def save(self, path: Path) -> None:
        np.savez(path, **{name: getattr(self, name) for name in ARRAYS})

    @classmethod
    def load(cls, path: Path) -> "MemoryCache":
        with np.load(path) as arrays:
            return cls(**{name: arrays[name] for name in ARRAYS})
