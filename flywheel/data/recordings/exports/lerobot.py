"""Episodes as a LeRobot data set, version 3.

    FOLDER/
      meta/info.json                                features, rate, splits
      meta/stats.json                               of all frames
      meta/tasks.parquet                            a text for each task_index: the episode's controller
      meta/episodes/chunk-000/file-000.parquet      a row for each episode
      data/chunk-000/file-000.parquet               a row for each frame

Frame t has the observation at time t and the command from t on, so the last observation is left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from flywheel.data.recordings.tables.columns import point_names
from flywheel.data.recordings.writing import Logged, created
from flywheel.errors import DataError
from flywheel.files import MB
from flywheel.records import Episode, Floats
from flywheel.robots import Robot

STATE, WINCHES, ACTION = "observation.state", "observation.winches", "action"
OWN = {"timestamp": "float32"} | dict.fromkeys(
    ("frame_index", "episode_index", "index", "task_index"), "int64"
)  # columns that every data set has
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
LARGEST = 100  # [MB] of a file of frames
MOST = 1000  # files in a folder


@dataclass(frozen=True)
class _Numbers:
    """Statistics of some frames' numbers (k,), without those that are missing.

    Attributes:
      many: (k,) numbers.
      mean: (k,); 0 without any.
      squares: (k,) sums of squared distances from the mean.
      low, high: (k,) the least and the greatest; infinite without any.
    """

    many: Floats
    mean: Floats
    squares: Floats
    low: Floats
    high: Floats

    @classmethod
    def of(cls, values: Floats) -> _Numbers:
        """Statistics of values (T, k)."""
        there = np.isfinite(values)
        many = there.sum(axis=0).astype(float)
        mean = np.where(there, values, 0).sum(axis=0) / np.maximum(many, 1)
        squares = (np.where(there, values - mean, 0) ** 2).sum(axis=0)
        low = np.where(there, values, np.inf).min(axis=0)
        return cls(many, mean, squares, low, np.where(there, values, -np.inf).max(axis=0))

    def __add__(self, other: _Numbers) -> _Numbers:
        many = np.maximum(self.many + other.many, 1)
        apart = other.mean - self.mean
        return _Numbers(
            self.many + other.many,
            (self.mean * self.many + other.mean * other.many) / many,
            self.squares + other.squares + apart**2 * self.many * other.many / many,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
        )

    def told(self, frames: int) -> dict[str, list[float]]:
        """As the format has them: always finite, since a NaN would spoil what is trained with them."""
        known = self.many > 0
        return {
            "min": np.where(known, self.low, 0).tolist(),
            "max": np.where(known, self.high, 0).tolist(),
            "mean": self.mean.tolist(),
            "std": np.sqrt(self.squares / np.maximum(self.many, 1)).tolist(),
            "count": [frames],
        }


def write_lerobot(
    episodes: Iterable[Episode], folder: str | Path, robot: Robot
) -> tuple[int, tuple[str, ...]]:
    """Write episodes of one robot and one control step into a new folder.

    Numbers are as precise as they are here; positions that were not seen are NaN.

    Args:
      episodes: at least one; those of one split follow each other.
      folder: that does not exist.
      robot: of all of them.

    Returns:
      The number of frames, and content that a log cannot hold, see `Logged`.

    Raises:
      DataError: the folder exists already, there is no episode, or one is of another robot or control step.
    """
    with created(folder) as place:
        place.mkdir()
        made = _DataSet(place, robot)
        for episode in episodes:
            made.add(episode)
        made.finish()
    return made.frames, tuple(made.left)


class _DataSet:
    """A data set that is being written.

    Attributes:
      frames: written so far.
      left: content of the episodes that is left out.
    """

    def __init__(self, folder: Path, robot: Robot) -> None:
        self.frames, self.left = 0, dict[str, None]()
        self._folder, self._robot = folder, robot
        self._file, self._size = -1, 0
        self._writer: parquet.ParquetWriter | None = None
        self._episodes: list[dict[str, Any]] = []
        self._tasks: dict[str, int] = {}
        self._dt = 0.0
        self._features: dict[str, Any] = {}
        self._whole: dict[str, _Numbers] = {}

    def add(self, episode: Episode) -> None:
        """Write an episode's frames."""
        log, track = Logged.of(episode, self._robot), episode.trajectory
        names, vectors = _vectors(log, self._robot)
        self._check_alike(episode, names, vectors)
        self.left |= dict.fromkeys(log.left)
        steps, number = track.steps, len(self._episodes)
        controller = episode.provenance.controller or "none"
        task = self._tasks.setdefault(controller, len(self._tasks))
        singles = {
            "timestamp": (track.dt * np.arange(steps)).astype(np.float32),
            "frame_index": np.arange(steps),
            "episode_index": np.full(steps, number),
            "index": self.frames + np.arange(steps),
            "task_index": np.full(steps, task),
        }
        self._write(_table(vectors, singles))
        numbers = {
            name: _Numbers.of(np.asarray(values, float).reshape(steps, -1))
            for name, values in (vectors | singles).items()
        }
        self._whole = {n: self._whole[n] + e if self._whole else e for n, e in numbers.items()}
        about = {
            "episode_index": number,
            "tasks": [controller],
            "length": steps,
            "data/chunk_index": self._file // MOST,
            "data/file_index": self._file % MOST,
            "dataset_from_index": self.frames,
            "dataset_to_index": self.frames + steps,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            "flywheel/episode": episode.id,
            "flywheel/split": episode.split,
            "flywheel/conditions": episode.provenance.conditions,
        }
        stats = {
            f"stats/{name}/{statistic}": value
            for name, each in numbers.items()
            for statistic, value in each.told(steps).items()
        }
        self._episodes.append(about | stats)
        self.frames += steps

    def _check_alike(
        self, episode: Episode, names: Mapping[str, list[str]], vectors: Mapping[str, Floats]
    ) -> None:
        """Raises DataError for an episode of another rate, or with other vectors, than those before."""
        dt = episode.trajectory.dt
        self._dt = self._dt or dt
        if dt != self._dt:
            raise DataError(
                f"Episode {episode.id} has steps of {dt:g} s, others of {self._dt:g} s; a LeRobot data "
                "set has one rate."
            )
        features = {
            name: {"dtype": "float64", "shape": [len(names[name])], "names": names[name]}
            for name in vectors
        }
        if self._features not in ({}, features):
            raise DataError(
                f"Episode {episode.id} has tensions or lengths of other cables than others; a LeRobot "
                "data set has the same of all."
            )
        self._features = features

    def finish(self) -> None:
        """Write what is about all episodes."""
        if self._writer is None:
            raise DataError("There is no episode to export.")
        self._writer.close()
        meta = self._folder / "meta"
        place = meta / "episodes" / FILE.format(chunk_index=0, file_index=0)
        place.parent.mkdir(parents=True)
        parquet.write_table(pa.Table.from_pylist(self._episodes), place)
        parquet.write_table(_tasks(self._tasks), meta / "tasks.parquet")
        rate = 1 / self._dt
        info = {
            "codebase_version": "v3.0",
            "robot_type": self._robot.name,
            "total_episodes": len(self._episodes),
            "total_frames": self.frames,
            "total_tasks": len(self._tasks),
            "chunks_size": MOST,
            "data_files_size_in_mb": LARGEST,
            "video_files_size_in_mb": LARGEST,
            "fps": round(rate) if abs(rate - round(rate)) < 1e-6 * rate else rate,
            "splits": _ranges([one["flywheel/split"] for one in self._episodes]),
            "data_path": f"data/{FILE}",
            "video_path": None,
            "features": self._features
            | {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in OWN.items()},
        }
        stats = {name: each.told(self.frames) for name, each in self._whole.items()}
        for name, content in (("info", info), ("stats", stats)):
            (meta / f"{name}.json").write_text(json.dumps(content, indent=4), encoding="utf-8")

    def _write(self, table: pa.Table) -> None:
        if self._writer is None or self._size + table.nbytes > LARGEST * MB:
            if self._writer is not None:
                self._writer.close()
            self._file, self._size = self._file + 1, 0
            chunk, file = divmod(self._file, MOST)
            place = self._folder / "data" / FILE.format(chunk_index=chunk, file_index=file)
            place.parent.mkdir(parents=True, exist_ok=True)
            self._writer = parquet.ParquetWriter(place, table.schema)
        self._size += table.nbytes
        self._writer.write_table(table)


def _vectors(log: Logged, robot: Robot) -> tuple[dict[str, list[str]], dict[str, Floats]]:
    """Names of the numbers of each vector of a frame, and the vectors (T, k)."""
    names = {
        STATE: point_names(robot),
        WINCHES: list(log.sensors),
        ACTION: [winch.name for winch in robot.winches],
    }
    points = log.points[:-1].reshape(len(log.controls), -1)
    vectors = {STATE: points, WINCHES: log.winch[:-1], ACTION: log.controls}
    for kind in dict.fromkeys(channel.kind for channel in log.channels):
        some, name = [c for c in log.channels if c.kind == kind], f"observation.{kind}"
        names[name] = [channel.name for channel in some]
        vectors[name] = np.stack([channel.values[:-1] for channel in some], axis=1)
    return names, {name: values for name, values in vectors.items() if names[name]}


def _ranges(splits: Sequence[str]) -> dict[str, str]:
    """Split -> its range of episodes, which are together."""
    return {
        split: f"{splits.index(split)}:{splits.index(split) + splits.count(split)}"
        for split in splits
    }


def _table(vectors: Mapping[str, Floats], singles: Mapping[str, Any]) -> pa.Table:
    """Frames of an episode. A vector of one number is a plain column, as the format wants it."""
    columns = {}
    for name, values in vectors.items():
        flat, width = pa.array(values.ravel()), values.shape[1]
        columns[name] = flat if width == 1 else pa.FixedSizeListArray.from_arrays(flat, width)
    return pa.table(columns | {name: pa.array(values) for name, values in singles.items()})


def _tasks(tasks: Mapping[str, int]) -> pa.Table:
    """Numbers of the tasks; their texts are the index of a table of pandas."""
    kinds = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
    about = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [
            {"name": n, "field_name": n, "pandas_type": a, "numpy_type": b, "metadata": None}
            for n, (a, b) in kinds.items()
        ],
        "pandas_version": "2.0",
    }
    table = pa.table({"task_index": list(tasks.values()), "task": list(tasks)})
    return table.replace_schema_metadata({"pandas": json.dumps(about)})
