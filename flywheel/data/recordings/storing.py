"""Recordings in the store: each content once, under a name that ends in its digest."""

from __future__ import annotations

import numpy as np

from flywheel.data.catalogue import EpisodeSummary
from flywheel.data.recordings.reading import DIGITS, Imported
from flywheel.data.store import TrajectoryStore
from flywheel.errors import DataError
from flywheel.records import Episode


def store_recording(store: TrajectoryStore, imported: Imported) -> tuple[str, bool]:
    """Commit a recording as one segment, unless it exists already.

    Returns:
      The segment's name, and True if it is new.

    Raises:
      DataError: the same log exists under another split or read with other settings; an episode
        never changes.
      RunError: the disk is full.
    """
    there = stored_recordings(store)
    digest = imported.report.digest[:DIGITS]
    for segment, summaries in there.items():
        if segment.endswith(digest):
            _check_same(imported, segment, summaries, store)
            return segment, False
    store.commit(imported.name, imported.episodes)
    return imported.name, True


def stored_recordings(store: TrajectoryStore) -> dict[str, tuple[EpisodeSummary, ...]]:
    """Segments of recordings in a store, by name."""
    return {
        name: receipt.summaries
        for name, receipt in sorted(store.committed().items())
        if receipt.summaries and all(s.source == "recording" for s in receipt.summaries)
    }


def _check_same(
    imported: Imported, segment: str, summaries: tuple[EpisodeSummary, ...], store: TrajectoryStore
) -> None:
    file, new = imported.report.file, imported.episodes
    if imported.split_given and new[0].split != summaries[0].split:
        raise DataError(
            f"{file} is stored already as {segment}, in the split {summaries[0].split}; an "
            f"episode keeps its split, {new[0].split} was requested."
        )
    old = store.read_segment(segment)
    if len(old) != len(new) or not all(_alike(a, b) for a, b in zip(old, new, strict=True)):
        raise DataError(
            f"{file} is stored already as {segment}, but was read with other settings (robot, map "
            "or dt); an episode never changes. Import it into another store, or leave it."
        )


def _alike(old: Episode, new: Episode) -> bool:
    a, b = old.trajectory, new.trajectory
    return (
        (a.dt, old.provenance.robot, old.provenance.conditions)
        == (b.dt, new.provenance.robot, new.provenance.conditions)
        and np.array_equal(a.controls, b.controls)
        and np.array_equal(a.observations.points, b.observations.points, equal_nan=True)
        and np.array_equal(a.observations.winch, b.observations.winch, equal_nan=True)
    )
