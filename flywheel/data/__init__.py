"""Storage of episodes, and their access in training."""

from flywheel.data.cache_files import SplitSource
from flywheel.data.catalogue import Damage, EpisodeSummary, Receipt, Snapshot
from flywheel.data.splits import assign_split
from flywheel.data.store import TrajectoryStore
from flywheel.data.windows import WindowBatch, WindowCache

__all__ = [
    "Damage",
    "EpisodeSummary",
    "Receipt",
    "Snapshot",
    "SplitSource",
    "TrajectoryStore",
    "WindowBatch",
    "WindowCache",
    "assign_split",
]
