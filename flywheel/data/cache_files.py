"""The files behind a window cache: flat arrays in a folder, made at once and checked when opened.

<folder>/<snapshot>-<split>-<belief>-v4/about.json   what it is of, with the sha256 of every file
<folder>/<snapshot>-<split>-<belief>-v4/<array>.npy
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from flywheel.data.catalogue import EpisodeSummary, Snapshot
from flywheel.data.packing import TERRAINS, packed_terrains
from flywheel.data.places import full_disk_told, new_workspace, sweep_workspaces
from flywheel.data.store import TrajectoryStore
from flywheel.errors import DataError
from flywheel.files import read_bytes
from flywheel.records import Episode, Floats, KnownWinch, Split
from flywheel.robots import GRAVITY, Robot
from flywheel.seals import Seal, check_seal, file_sha256, sealed, unsealed
from flywheel.smoothing import savitzky_golay
from flywheel.terrain import Terrain

VERSION = 4  # version of the arrays' meaning
ROWS = (  # one row per observation
    "points",
    "points_truth",
    "winch",
    "winch_truth",
    "controls",
    "valid",
)
EPISODES = ("lengths", "dataset")
ARRAYS = (*ROWS, *EPISODES, *TERRAINS)
_ABOUT = "about.json"
_SMOOTHED = 0.3  # length of the parabolas that smooth measured points [sqrt(L / g)]
Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class SplitSource:
    """The episodes of one split of a snapshot, with the knowledge about their winches.

    Attributes:
      store: of the snapshot.
      snapshot: sealed.
      split: of the episodes.
      robot: of the episodes.
      winches: best known positions; None for `Robot.winches_of`.
      belief: name of the knowledge in `winches`, part of the cache's identity.
    """

    store: TrajectoryStore
    snapshot: Snapshot
    split: Split
    robot: Robot
    winches: KnownWinch | None = None
    belief: str = ""

    @property
    def folder_name(self) -> str:
        """Name of its cache's folder."""
        known = "-".join(filter(None, (self.belief, f"v{VERSION}")))
        return f"{self.snapshot.digest[:16]}-{self.split}-{known}"

    @property
    def about(self) -> dict[str, Any]:
        """Content of its cache's about.json."""
        return {"snapshot": self.snapshot.digest, "split": self.split}


def cached_arrays(source: SplitSource, folder: Path) -> Arrays:
    """Arrays of a cache, mapped into memory; a cache that is missing or damaged is made first.

    Args:
      source: of the cache.
      folder: for caches; each has its own subfolder.

    Raises:
      DataError: the split is empty, an episode is damaged, or the cache cannot be read back.
      RunError: the disk is full.
    """
    target = folder / source.folder_name
    if (arrays := _opened(target, source)) is not None:
        return arrays
    sweep_workspaces(folder)
    with full_disk_told(f"the cache of snapshot {source.snapshot.name} was not made", folder):
        work = new_workspace(folder)
        try:
            (work / "new").mkdir()
            _fill(work / "new", source)
            if _opened(target, source) is None and target.exists():
                target.rename(work / "old")
            with suppress(OSError):  # another process has made it in the meantime
                (work / "new").rename(target)
        finally:
            shutil.rmtree(work, ignore_errors=True)
    if (arrays := _opened(target, source)) is None:
        raise DataError(
            f"The cache at {target} cannot be read just after it was made; check the disk."
        )
    return arrays


def _opened(target: Path, source: SplitSource) -> Arrays | None:
    """A cache's arrays, or None if there is no complete one of this source."""
    try:
        about, seal = unsealed(read_bytes(target / _ABOUT, "file", DataError), _ABOUT)
        if about != source.about:
            return None
        check_seal(seal, "cache", target.name, _ABOUT)
        wanted = {name: file_sha256(target / f"{name}.npy", "array") for name in ARRAYS}
        if seal.rests_on != wanted:
            return None
        arrays = {n: np.load(target / f"{n}.npy", mmap_mode="r") for n in ROWS + EPISODES}
        arrays |= {n: np.load(target / f"{n}.npy") for n in TERRAINS}
    except (OSError, ValueError, DataError):
        return None
    return {name: np.asarray(array) for name, array in arrays.items()}  # plain views are faster


def _fill(work: Path, source: SplitSource) -> None:
    snapshot, split, robot = source.snapshot, source.split, source.robot
    wanted = {e.id: e for e in snapshot.episodes if e.split == split}
    if not wanted:
        have = sorted({e.split for e in snapshot.episodes})
        raise DataError(
            f"Snapshot {snapshot.name} has no {split} episode; all {len(snapshot.episodes)} of its "
            f"episodes are in: {', '.join(have)}."
        )
    winches = source.winches or robot.winches_of
    rows = sum(e.steps + 1 for e in wanted.values())
    with ExitStack() as stack:
        files: dict[str, BinaryIO] = {}
        terrains: list[Terrain | None] = []
        for episode in _episodes(source.store, snapshot, wanted):
            terrains.append(episode.terrain)
            for name, values in _columns(episode, robot, winches).items():
                if name not in files:
                    files[name] = stack.enter_context((work / f"{name}.npy").open("wb"))
                    _write_header(files[name], values.dtype, (rows, *values.shape[1:]))
                files[name].write(values.tobytes())
    order = list(wanted.values())
    np.save(work / "lengths.npy", np.array([e.steps for e in order], np.int64))
    index = [snapshot.datasets.index(e.dataset) for e in order]
    np.save(work / "dataset.npy", np.array(index, np.int64))
    for name, values in packed_terrains(terrains).items():
        np.save(work / f"{name}.npy", values)
    digests = {array: file_sha256(work / f"{array}.npy", "array") for array in ARRAYS}
    seal = Seal("cache", source.folder_name, "", digests)
    (work / _ABOUT).write_bytes(sealed(source.about, seal))


def _episodes(
    store: TrajectoryStore, snapshot: Snapshot, wanted: Mapping[str, EpisodeSummary]
) -> Iterator[Episode]:
    """The selected episodes, in the snapshot's order."""
    needed = {e.segment for e in wanted.values()}
    for segment, sha256 in zip(snapshot.segments, snapshot.sha256, strict=True):
        for episode in store.read_segment(segment, sha256) if segment in needed else ():
            if episode.id in wanted:
                _check_listed(episode, wanted[episode.id])
                yield episode


def _write_header(file: BinaryIO, dtype: np.dtype[Any], shape: tuple[int, ...]) -> None:
    description = np.lib.format.dtype_to_descr(dtype)
    header = {"descr": description, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)


def _check_listed(episode: Episode, listed: EpisodeSummary) -> None:
    if (episode.split, episode.trajectory.steps) != (listed.split, listed.steps):
        raise DataError(
            f"Episode {episode.id} is {episode.split} with {episode.trajectory.steps} steps; its "
            f"snapshot lists it as {listed.split} with {listed.steps}."
        )


def _columns(episode: Episode, robot: Robot, winches: KnownWinch) -> Arrays:
    track = episode.trajectory
    seen = track.observations
    columns: dict[str, Floats] = {
        "points": seen.points,
        "points_truth": (
            _smoothed(seen.points, track.dt, robot)
            if track.states is None or not robot.free
            else robot.points_of(track.states)
        ),
        "winch": winches(episode),
        "winch_truth": seen.winch if track.states is None else robot.winch_of(track.states),
        "controls": np.concatenate([track.controls, np.zeros_like(track.controls[:1])]),
    }
    arrays: Arrays = {name: values.astype(np.float32) for name, values in columns.items()}
    return arrays | {"valid": seen.valid}


def _smoothed(points: Floats, dt: float, robot: Robot) -> Floats:
    """Measured points (T + 1, P, 3) without most of their noise; NaN stays.

    Noise of a millimetre at a hundredth of a second is more speed than a robot changes in a chunk.
    """
    known = np.asarray(np.isfinite(points).all(axis=-1))
    if not known.any(axis=0).all():
        return points
    smooth, _ = savitzky_golay(points, dt, _SMOOTHED * (robot.length / GRAVITY) ** 0.5)
    return np.where(known[..., None], smooth, points)
