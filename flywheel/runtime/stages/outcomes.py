"""What the stages of an iteration hand on to each other."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from flywheel.runtime.pool.jobs import PoolReport
from flywheel.runtime.results import Errors, Navigation, Overlay
from flywheel.runtime.run.context import Model
from flywheel.runtime.workers.trainer_worker import TrainingNote


@dataclass
class Tally:
    """What an iteration cost.

    Attributes:
      seconds: wall time per stage [s].
      cpu_seconds: that workers spent on jobs, see `PoolReport` [s].
      restarts: workers replaced.
      problems: sentences about episodes that are missing.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    cpu_seconds: float = 0.0
    restarts: int = 0
    problems: list[str] = field(default_factory=list)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the wall time of a block to a stage."""
        begun = time.monotonic()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.monotonic() - begun

    def add(self, report: PoolReport) -> PoolReport:
        """Count what a call of the pool did."""
        self.restarts += report.restarts
        self.cpu_seconds += report.cpu_seconds
        for job in report.quarantined:
            why = "; ".join(sorted(set(job.deaths)))
            self.problems.append(f"{job.id} was set aside after {len(job.deaths)} workers: {why}")
        return report


@dataclass(frozen=True)
class Collected:
    """What one arm recorded.

    Attributes:
      segments: valid ones, in the order of the plan.
      steps: control steps in them.
      invalid: episodes thrown away because something diverged.
      quarantined: episodes set aside because they took workers down.
    """

    segments: tuple[str, ...]
    steps: int
    invalid: int
    quarantined: int


@dataclass(frozen=True)
class Trained:
    """A model and how it came about; no model where the training diverged."""

    model: Model | None
    note: TrainingNote


@dataclass(frozen=True)
class Evaluated:
    """What is known about one model. None where it was not run.

    Attributes:
      validation, champion_validation: errors of the model and of the champion on the same episodes.
      test: errors on the simulated test episodes so far.
      recordings: errors on the recordings that are kept for tests.
      navigation, champion_navigation: closed-loop episodes.
      overlay: one window of a test episode.
    """

    validation: Errors | None = None
    champion_validation: Errors | None = None
    test: Errors | None = None
    recordings: Errors | None = None
    navigation: Navigation | None = None
    champion_navigation: Navigation | None = None
    overlay: Overlay | None = None
