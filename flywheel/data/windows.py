"""Windows of a snapshot's episodes, gathered from memory-mapped arrays.

Zarr is read once per snapshot; training then gathers from flat float32 files that the operating
system keeps in memory. A cache is a copy: it may be deleted at any time.
"""

from __future__ import annotations

import json
import os
import shutil
import uuid
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flywheel.data.catalogue import Snapshot
from flywheel.data.store import TrajectoryStore
from flywheel.errors import DataError
from flywheel.records import Episode, Floats, Split
from flywheel.robots import Robot

_ARRAYS = ("points", "winch", "winch_truth", "controls", "lengths", "dataset")
_ABOUT = "about.json"


@dataclass(frozen=True)
class WindowBatch:
    """B windows of L control steps.

    Attributes:
      points: (B, L + 1, P, 3) measured [m]; NaN where missing.
      controls: (B, L, W).
      winch: (B, L + 1, W) best knowledge of the winch positions: measured, else dead-reckoned [m].
      winch_truth: (B, L + 1, W) the plant's, or as measured; NaN where neither is known [m].
      dataset: (B,) index into the snapshot's data sets.
    """

    points: Floats
    controls: Floats
    winch: Floats
    winch_truth: Floats
    dataset: NDArray[np.int64]


@dataclass(frozen=True)
class WindowCache:
    """The episodes of one split of a snapshot, end to end; every array has one row per observation.

    Attributes:
      points, winch, winch_truth, controls: memory maps as in `WindowBatch`, (N, ...); the controls
        of an episode's last row mean nothing.
      lengths: (E,) control steps of each episode.
      dataset: (E,) index of its data set.
      datasets: names by index.
      digest: of the snapshot.
    """

    points: Floats
    winch: Floats
    winch_truth: Floats
    controls: Floats
    lengths: NDArray[np.int64]
    dataset: NDArray[np.int64]
    datasets: tuple[str, ...]
    digest: str

    @classmethod
    def build(
        cls, store: TrajectoryStore, snapshot: Snapshot, split: Split, folder: Path, robot: Robot
    ) -> WindowCache:
        """Open the cache of a snapshot's split, and fill it first if there is none.

        Args:
          store: that holds the snapshot.
          snapshot: sealed.
          split: whose episodes to cache.
          folder: for caches; each has a folder of its own inside.
          robot: of the episodes.

        Raises:
          DataError: the split is empty, an episode is damaged, or it is another robot's.
        """
        if snapshot.robot != robot.digest:
            raise DataError(
                f"Snapshot {snapshot.name} is of robot {snapshot.robot[:12]}, not of {robot.name} "
                f"({robot.digest[:12]})."
            )
        target = Path(folder) / f"{snapshot.digest[:16]}-{split}"
        if not (target / _ABOUT).exists():
            _fill(target, store, snapshot, split, robot)
        arrays = {
            name: np.load(target / f"{name}.npy", mmap_mode="r" if name in _ARRAYS[:4] else None)
            for name in _ARRAYS
        }
        return cls(**arrays, datasets=snapshot.datasets, digest=snapshot.digest)

    def starts(self, length: int, stride: int = 1) -> NDArray[np.int64]:
        """First rows of all windows of `length` control steps that lie within one episode."""
        first = self._first_rows()
        return np.concatenate(
            [
                np.arange(row, row + steps - length + 1, stride, dtype=np.int64)
                for row, steps in zip(first, self.lengths, strict=True)
            ]
            or [np.zeros(0, np.int64)]
        )

    def gather(self, starts: NDArray[np.int64], length: int) -> WindowBatch:
        """The windows of `length` control steps that start at rows `starts` (B,)."""
        rows = np.asarray(starts)[:, None] + np.arange(length + 1)
        episode = np.searchsorted(self._first_rows(), starts, side="right") - 1
        return WindowBatch(
            points=self.points[rows],
            controls=self.controls[rows[:, :-1]],
            winch=self.winch[rows],
            winch_truth=self.winch_truth[rows],
            dataset=self.dataset[episode],
        )

    def _first_rows(self) -> NDArray[np.int64]:
        return np.concatenate([[0], np.cumsum(self.lengths[:-1] + 1)]).astype(np.int64)


def _fill(
    target: Path, store: TrajectoryStore, snapshot: Snapshot, split: Split, robot: Robot
) -> None:
    wanted = [e for e in snapshot.episodes if e.split == split]
    if not wanted:
        have = sorted({e.split for e in snapshot.episodes})
        raise DataError(
            f"Snapshot {snapshot.name} has no {split} episode; all {len(snapshot.episodes)} of its "
            f"episodes are in: {', '.join(have)}."
        )
    names = {e.id for e in wanted}
    segments = dict.fromkeys(e.segment for e in wanted)
    episodes = [e for s in segments for e in store.read_segment(s) if e.id in names]
    columns = [_columns(e, robot) for e in episodes]
    work = target.with_name(f".{target.name}.{os.getpid()}.{uuid.uuid4().hex}")
    work.mkdir(parents=True)
    for i, name in enumerate(_ARRAYS[:4]):
        np.save(work / f"{name}.npy", np.concatenate([c[i] for c in columns]).astype(np.float32))
    np.save(work / "lengths.npy", np.array([e.trajectory.steps for e in episodes], np.int64))
    index = [snapshot.datasets.index(e.provenance.dataset) for e in episodes]
    np.save(work / "dataset.npy", np.array(index, np.int64))
    about = {"snapshot": snapshot.digest, "split": split, "episodes": [e.id for e in episodes]}
    (work / _ABOUT).write_text(json.dumps(about))
    try:
        work.rename(target)
    except OSError:  # another process was faster
        shutil.rmtree(work, ignore_errors=True)


def _columns(episode: Episode, robot: Robot) -> tuple[Floats, Floats, Floats, Floats]:
    track = episode.trajectory
    known = robot.known_winch(track.observations.winch, track.controls, track.dt)
    truth = track.observations.winch if track.states is None else robot.winch_of(track.states)
    controls = np.concatenate([track.controls, np.zeros_like(track.controls[:1])])
    return track.observations.points, known, truth, controls
