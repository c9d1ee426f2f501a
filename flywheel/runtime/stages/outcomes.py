"""The records passed between the stages of an iteration."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from flywheel.data import Snapshot
from flywheel.results import (
    Arm,
    DiagnosisNote,
    Errors,
    GateDecision,
    IterationResult,
    Navigation,
    Overlay,
    RobotResult,
)
from flywheel.runtime.pool.jobs import PoolReport
from flywheel.runtime.run.context import Model, usable
from flywheel.runtime.workers.episode_plan import Effects
from flywheel.runtime.workers.trainer_worker import TrainingNote


@dataclass
class Iteration:
    """An iteration in progress: what it begins with, and its cost so far, in all arms together.

    Attributes:
      number: of the iteration, from 0.
      latest: arm -> the iteration whose model the arm continues from; None before the first.
      models: arm -> the model of that iteration, if there is one.
      diagnosis: of the plant, before the episodes; None without one.
      effects: of the plant, beyond the MJCF.
      seconds: wall time of each stage [s].
      cpu_seconds: processor time of the workers for jobs [s].
      restarts: number of replaced workers.
      problems: sentences about missing episodes.
    """

    number: int
    latest: Mapping[Arm, IterationResult | None] = field(default_factory=dict)
    models: Mapping[Arm, Model] = field(default_factory=dict)
    diagnosis: DiagnosisNote | None = None
    effects: Effects = ()
    seconds: dict[str, float] = field(default_factory=dict)
    cpu_seconds: float = 0.0
    restarts: int = 0
    problems: list[str] = field(default_factory=list)

    @property
    def anew(self) -> bool:
        """True if a diagnosis before it changed the plant."""
        return self.diagnosis is not None and self.diagnosis.adopted

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
      arm: of the episodes.
      segments: names of the valid ones, in the order of the plan.
      steps: control steps in them.
      invalid: number of episodes discarded because something diverged.
      quarantined: number of episodes set aside because they killed workers.
    """

    arm: Arm
    segments: tuple[str, ...]
    steps: int
    invalid: int
    quarantined: int


@dataclass(frozen=True)
class Evaluated:
    """Evaluation of one model. A field is None if it was not measured.

    Attributes:
      validation, champion_validation: errors of the model, and of the arm's previous model, on the
        same episodes.
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
      snapshot: training data of the arm.
      model: the new model; None before the training, and if that diverged.
      training: the trainer's report.
      evaluated: the model's errors and closed-loop episodes.
      gate: decision about the champion; None before it, and in an arm without a gate.
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
