"""Speed of writing the store and of reading the cache."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flywheel.data.store import TrajectoryStore
from flywheel.data.windows import SplitSource, WindowCache
from flywheel.records import Episode, Observation, Provenance, State, Trajectory
from flywheel.robots import Robot


@dataclass(frozen=True)
class StoreSpeed:
    """Measured rates.

    Attributes:
      write_mb_per_s: committed (durable, read back, hashed) array bytes.
      windows_per_s: gathered from the memory-mapped cache.
      ram_windows_per_s: gathered from the same arrays in plain memory, in the same run.
    """

    write_mb_per_s: float
    windows_per_s: float
    ram_windows_per_s: float


def store_benchmark(
    robot: Robot,
    folder: Path,
    *,
    episodes: int = 16,
    seconds: float = 30.0,
    window: int = 64,
    batch: int = 256,
    repeats: int = 20,
) -> StoreSpeed:
    """Write random episodes of a robot into an empty folder and gather training windows of them."""
    rng = np.random.default_rng(0)
    stored = [_episode(robot, f"e{i:03d}", round(seconds / 0.01), rng) for i in range(episodes)]
    store = TrajectoryStore(folder / "store")
    began = time.perf_counter()
    for episode in stored:
        store.commit(episode.id, [episode])
    write = sum(map(_bytes, stored)) / 1e6 / (time.perf_counter() - began)
    snapshot = store.seal("bench", [e.id for e in stored])
    cache = WindowCache.build(SplitSource(store, snapshot, "train", robot), folder / "cache")
    names = ("points", "winch", "winch_truth", "controls")
    ram = [np.array(getattr(cache, name)) for name in names]
    starts = cache.starts(window)
    draws = [rng.choice(starts, batch) for _ in range(repeats)]

    def from_ram(chosen: np.ndarray) -> None:
        rows = chosen[:, None] + np.arange(window + 1)
        for array in ram:
            array[rows]

    rates: dict[str, float] = {"cache": 0.0, "ram": 0.0}
    ways: dict[str, Callable[[np.ndarray], object]] = {
        "cache": lambda chosen: cache.gather(chosen, window),
        "ram": from_ram,
    }
    for chosen in draws:  # interleaved, best of all
        for name, gather in ways.items():
            began = time.perf_counter()
            gather(chosen)
            rates[name] = max(rates[name], batch / (time.perf_counter() - began))
    return StoreSpeed(write, rates["cache"], rates["ram"])


def _episode(robot: Robot, name: str, steps: int, rng: np.random.Generator) -> Episode:
    key, winches = robot.keyframe, len(robot.winches)

    def walk(*shape: int) -> np.ndarray:
        return np.cumsum(0.01 * rng.standard_normal((steps + 1, *shape)), axis=0)

    return Episode(
        name,
        Trajectory(
            Observation(walk(len(robot.points), 3), np.full((steps + 1, winches), np.nan)),
            0.1 * rng.standard_normal((steps, winches)),
            0.01,
            State(walk(key.qpos.shape[-1]), walk(key.qvel.shape[-1]), walk(key.act.shape[-1])),
        ),
        Provenance(robot=robot.digest),
        "train",
    )


def _bytes(episode: Episode) -> int:
    track = episode.trajectory
    assert track.states is not None
    seen, states = track.observations, track.states
    arrays = (seen.points, seen.winch, track.controls, states.qpos, states.qvel, states.act)
    return sum(a.nbytes for a in arrays)
