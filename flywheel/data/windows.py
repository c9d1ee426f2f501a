"""Windows of a snapshot's episodes, gathered from memory-mapped arrays.

Zarr is read once per snapshot and split; training then gathers from flat float32 files that the
operating system keeps in memory. A cache is a copy: it may be deleted at any time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from flywheel.data.cache_files import SplitSource, cached_arrays
from flywheel.data.packing import TERRAINS, unpacked_terrains
from flywheel.errors import DataError
from flywheel.records import Floats, Split
from flywheel.terrain import Terrain


@dataclass(frozen=True)
class WindowBatch:
    """B windows of L control steps.

    Attributes:
      points: (B, L + 1, P, 3) measured [m]; NaN where missing.
      points_truth: (B, L + 1, P, 3) the plant's without noise, or measured and smoothed [m].
      controls: (B, L, W).
      winch: (B, L + 1, W) best estimate of the winch positions: measured, else dead-reckoned [m].
      winch_truth: (B, L + 1, W) the plant's, or measured; NaN if neither is known [m].
      dataset: (B,) index into the snapshot's data sets.
      terrains: under each of B, or one for all; None is the plane z = 0.
      angle: (B,) or (1,) rotation about the vertical [rad].
    """

    points: Floats
    points_truth: Floats
    controls: Floats
    winch: Floats
    winch_truth: Floats
    dataset: NDArray[np.int64]
    terrains: tuple[Terrain | None, ...] = (None,)
    angle: Floats = field(default_factory=lambda: np.zeros(1))


@dataclass(frozen=True)
class WindowCache:
    """The episodes of one split of a snapshot, end to end; every array has one row per observation.

    Attributes:
      points, points_truth, winch, winch_truth, controls: as in `WindowBatch`, (N, ...), float32,
        mapped into memory; the controls of an episode's last row are meaningless.
      valid: (N, P) True for measured points.
      lengths: (E,) control steps of each episode.
      dataset: (E,) index of its data set.
      terrains: of each episode; None is the plane z = 0.
      datasets: names by index.
      split: of all its episodes.
      digest: of the snapshot.
      belief: name of the knowledge about the winches.
    """

    points: Floats
    points_truth: Floats
    winch: Floats
    winch_truth: Floats
    controls: Floats
    valid: NDArray[np.bool_]
    lengths: NDArray[np.int64]
    dataset: NDArray[np.int64]
    terrains: tuple[Terrain | None, ...]
    datasets: tuple[str, ...]
    split: Split
    digest: str
    belief: str = ""

    @classmethod
    def build(cls, source: SplitSource, folder: Path) -> WindowCache:
        """Open the cache of a snapshot's split; fill it first if there is none, or a damaged one.

        Args:
          source: of the cache.
          folder: for caches; each has its own subfolder.

        Raises:
          DataError: the split is empty, an episode is damaged, or it is another robot's.
          RunError: the disk is full.
        """
        snapshot, robot = source.snapshot, source.robot
        if snapshot.robot != robot.digest:
            raise DataError(
                f"Snapshot {snapshot.name} is of robot {snapshot.robot[:12]}, not of {robot.name} "
                f"({robot.digest[:12]})."
            )
        arrays = cached_arrays(source, Path(folder))
        terrains = tuple(unpacked_terrains(arrays))
        own = {name: values for name, values in arrays.items() if name not in TERRAINS}
        return cls(
            **own,
            terrains=terrains,
            datasets=snapshot.datasets,
            split=source.split,
            digest=snapshot.digest,
            belief=source.belief,
        )

    def starts(self, length: int, past: int | None = None) -> NDArray[np.int64]:
        """First rows of the windows of `length` control steps within one episode.

        Args:
          length: L, at least 0.
          past: leave out those with a point missing in all of the first `past` steps: no prediction
            can start there. A recording has such places, e.g. while a marker is occluded.

        Raises:
          DataError: the length is negative.
        """
        if length < 0:
            raise DataError(f"Windows have a length >= 0, got {length}.")
        counts = np.maximum(0, self.lengths - length + 1)
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        starts = np.repeat(self._first_rows(), counts) + within
        if past is not None and not self.valid.all():
            before = np.zeros((len(self.valid) + 1, self.valid.shape[1]), np.int64)
            np.cumsum(self.valid, axis=0, out=before[1:])
            starts = starts[(before[starts + past + 1] > before[starts]).all(axis=1)]
        return starts.astype(np.int64)

    def gather(self, starts: NDArray[np.int64], length: int) -> WindowBatch:
        """The windows of `length` control steps that start at rows `starts` (B,).

        Raises:
          DataError: a window is not within one episode.
        """
        starts = np.asarray(starts, np.int64)
        first = self._first_rows()
        episode = np.searchsorted(first, starts, side="right") - 1
        beyond = (starts < 0) | (starts + length > first[episode] + self.lengths[episode])
        if beyond.any():
            raise DataError(
                f"A window of {length} steps from row {starts[beyond][0]} leaves its episode; take "
                "starts from `starts(length)`."
            )
        return WindowBatch(
            points=_runs(self.points, starts, length + 1),
            points_truth=_runs(self.points_truth, starts, length + 1),
            controls=_runs(self.controls, starts, length),
            winch=_runs(self.winch, starts, length + 1),
            winch_truth=_runs(self.winch_truth, starts, length + 1),
            dataset=self.dataset[episode],
            terrains=tuple(self.terrains[e] for e in episode) if any(self.terrains) else (None,),
        )

    def _first_rows(self) -> NDArray[np.int64]:
        return np.cumsum(self.lengths + 1) - (self.lengths + 1)


def _runs(array: Floats, starts: NDArray[np.int64], rows: int) -> Floats:
    """Copies (B, rows, ...) of consecutive rows of an array (N, ...).

    One contiguous copy per window, 3 to 4 times faster than an index per row.
    """
    flat = np.ascontiguousarray(array).reshape(len(array), -1)
    step, item = flat.strides
    shape = (max(0, len(flat) - rows + 1), rows * flat.shape[1])
    runs = as_strided(flat, shape, (step, item), writeable=False)
    return runs[starts].reshape(len(starts), rows, *array.shape[1:])
