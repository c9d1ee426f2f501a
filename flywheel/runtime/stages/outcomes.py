"""The records that the stages of an iteration hand on to each other."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from flywheel.data import Snapshot
from flywheel.results import Arm, Errors, GateDecision, Navigation, Overlay, RobotResult
from flywheel.runtime.pool.jobs import PoolReport
from flywheel.runtime.run.context import Model, usable
from flywheel.runtime.workers.trainer_worker import TrainingNote


@dataclass
class Tally:
    """Cost of an iteration, in all arms together.

    Attributes:
      seconds: wall time of each stage [s].
      cpu_seconds: processor time that the workers spent on jobs [s].
      restarts: number of workers that were replaced.
      problems: sentences about episodes that are missing.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    cpu_seconds: float = 0.0
    restarts: int = 0
    problems: list[str] = field(default_factory=list)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the wall time of the block to a stage."""
        begun = time.monotonic()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.monotonic() - begun

    def add(self, report: PoolReport) -> PoolReport:
        """Add the cost of one call of the pool; returns the report unchanged."""
        self.restarts += report.restarts
        self.cpu_seconds += report.cpu_seconds
        for job in report.quarantined:
            why = "; ".join(sorted(set(job.deaths)))
            self.problems.append(f"{job.id} was set aside after {len(job.deaths)} workers: {why}")
        return report


@dataclass(frozen=True)
class Collected:
    """The episodes that one arm collected in an iteration.

    Attributes:
      arm: that collected them.
      segments: names of the valid ones, in the order of the plan.
      steps: control steps in them.
      invalid: number of episodes thrown away because something diverged.
      quarantined: number of episodes set aside because they took workers down.
    """

    arm: Arm
    segments: tuple[str, ...]
    steps: int
    invalid: int
    quarantined: int


@dataclass(frozen=True)
class Evaluated:
    """How good one model is. A field is None where it was not measured.

    Attributes:
      validation, champion_validation: errors of the model, and of the arm's model before it, on the same
        episodes.
      test: errors on the simulated test episodes so far.
      recordings: errors on the recordings that are kept for tests.
      navigation, champion_navigation: closed-loop episodes.
      overlay: one window of a test episode, measured and predicted.
      robot: errors and drives on the robot.
    """

    validation: Errors | None = None
    champion_validation: Errors | None = None
    test: Errors | None = None
    recordings: Errors | None = None
    navigation: Navigation | None = None
    champion_navigation: Navigation | None = None
    overlay: Overlay | None = None
    robot: RobotResult | None = None


@dataclass(frozen=True)
class ArmOutcome:
    """State of an iteration in one arm. Each stage returns a copy with its own part filled in.

    Attributes:
      collected: the arm's new episodes.
      snapshot: the data that the arm learns from.
      model: the new model; None before the training, and where that diverged.
      training: the trainer's report.
      evaluated: the model's errors and closed-loop episodes.
      gate: whether the model becomes the champion; None before that is decided, and in an arm without.
    """

    collected: Collected
    snapshot: Snapshot
    model: Model | None = None
    training: TrainingNote = field(default_factory=TrainingNote)
    evaluated: Evaluated = Evaluated()
    gate: GateDecision | None = None

    @property
    def arm(self) -> Arm:
        """Name of the arm."""
        return self.collected.arm

    @property
    def usable_model(self) -> Model | None:
        """The model, if its predictions on the validation episodes are finite."""
        return self.model if usable(self.evaluated.validation) else None
