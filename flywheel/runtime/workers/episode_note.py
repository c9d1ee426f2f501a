"""The report to the driver about a recorded episode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.records import Episode
from flywheel.results import Walk


@dataclass(frozen=True)
class EpisodeNote:
    """The report to the driver about a recorded episode.

    Attributes:
      id: of the episode.
      steps: control steps; 0 if invalid.
      walk: seen from above, for tasks.
      plan_seconds: wall time of its plans [s].
      invalid: reason for discarding it, or "".
    """

    id: str
    steps: int = 0
    walk: Walk | None = None
    plan_seconds: tuple[float, ...] = ()
    invalid: str = ""

    @classmethod
    def of(cls, episode: Episode, walk: Walk | None) -> EpisodeNote:
        """The report about an episode that is in the store."""
        seconds = np.round(episode.telemetry.get("plan_seconds", np.zeros(0)), 5)
        return cls(
            episode.id,
            steps=episode.trajectory.steps,
            walk=walk,
            plan_seconds=tuple(float(s) for s in seconds),
        )
