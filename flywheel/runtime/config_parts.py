"""The parts of a run's configuration that the runtime itself owns."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, field_validator

from flywheel.diagnosis.calibration import unsure_terms
from flywheel.effects import NAMED
from flywheel.errors import DataError, FlywheelError, UnknownNameError
from flywheel.registry import lookup
from flywheel.robots import load_course

SHARE = Field(default=0.2, ge=0.0, lt=1.0)


class Part(BaseModel):
    """Frozen, and no unknown key passes."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class CollectConfig(Part):
    """Which episodes are recorded for training.

    Attributes:
      gaits, random, drops: episodes of each kind in iteration 0, spread over the data sets.
      gait_seconds, random_seconds, drop_seconds: their durations [s].
      gait_variation: the most by which the cable lengths of a gait's targets are off at random [-];
        each gait starts from where the robot came to rest after a random drop.
      mppi: episodes that each later iteration adds.
      mppi_seconds: their longest duration [s].
      mppi_samples: plans that are tried at a time for them; None for as many as `mppi.samples`. Data
        want variety, goals the best plan.
      validation: share of the episodes of each kind that is kept for validation.
      test: share of the episodes of each kind of iteration 0 that is kept for tests.
      recordings: segments already in the store that belong to the data from iteration 0 on.
    """

    gaits: int = Field(default=6, ge=0)
    gait_seconds: float = Field(default=30.0, gt=0)
    gait_variation: float = Field(default=0.15, ge=0, le=0.5)
    random: int = Field(default=10, ge=0)
    random_seconds: float = Field(default=30.0, gt=0)
    drops: int = Field(default=4, ge=0)
    drop_seconds: float = Field(default=5.0, gt=0)
    mppi: int = Field(default=10, ge=1)
    mppi_seconds: float = Field(default=30.0, gt=0)
    mppi_samples: int | None = Field(default=None, ge=1)
    validation: float = SHARE
    test: float = SHARE
    recordings: tuple[str, ...] = ()


class EvaluateConfig(Part):
    """How models are judged.

    Predictions start from what was measured. They are compared with what really happened, where a
    simulated episode tells; with a recording's own measurements else.

    Attributes:
      tasks: closed-loop episodes per model, each as long as `task.seconds` at most; the same tasks
        for every model.
      horizon_seconds: of the short-horizon errors [s].
      starts: predictions per episode, for the short-horizon errors.
      full: also predict whole episodes.
      oracle: also run the tasks with a planner that knows the plant (the ceiling).
      floor: also score the plant restarted from partial observations (the floor).
      floor_window: past steps from which the floor estimates velocities; more than 1 for noisy points.
      video: render one episode per iteration, and per unseen course.
      unseen: courses, as in `task.course`, that the last champion drives through at the end, as many times
        as there are tasks; nothing is learned there.
    """

    tasks: int = Field(default=8, ge=0)
    horizon_seconds: float = Field(default=2.0, gt=0)
    starts: int = Field(default=10, ge=1)
    full: bool = True
    oracle: bool = True
    floor: bool = True
    floor_window: int = Field(default=1, ge=1)
    video: bool = True
    unseen: tuple[str, ...] = ()

    @field_validator("unseen")
    @classmethod
    def _can_be_read(cls, courses: tuple[str, ...]) -> tuple[str, ...]:
        try:
            for course in courses:
                load_course(course)
        except FlywheelError as error:
            raise ValueError(str(error)) from None
        return courses


class DiagnoseConfig(Part):
    """Whether, before it collects again, a run asks what its plant lacks to explain the recordings.

    What is found, and confirmed by the recordings that are kept for tests, is added to the plant; the
    first iteration's episodes are then simulated anew, and those of the old plant left out.

    Attributes:
      on: ask, from iteration 1 on.
      effects: that may be missing, by name; all of the library by default.
      unsure: what the MJCF says only so well: effect -> standard deviation, see `diagnosis.calibration`.
      seconds: of recordings that are looked at, at most; as many of those kept for tests [s].
      window_seconds: length of the windows [s]; None for what suits the robot.
    """

    on: bool = False
    effects: tuple[str, ...] = ()
    unsure: dict[str, float] = Field(default_factory=dict)
    seconds: float = Field(default=12.0, gt=0)
    window_seconds: float | None = Field(default=None, gt=0)

    @field_validator("effects")
    @classmethod
    def _known(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        try:
            for name in names:
                lookup(NAMED, name, "effect")
        except UnknownNameError as error:
            raise ValueError(str(error)) from None
        return names

    @field_validator("unsure")
    @classmethod
    def _can_be(cls, unsure: dict[str, float]) -> dict[str, float]:
        try:
            unsure_terms(unsure)
        except (DataError, UnknownNameError) as error:
            raise ValueError(str(error)) from None
        return unsure


class GateConfig(Part):
    """When a new model replaces the champion.

    Attributes:
      error_ratio: its validation error may be at most this times the champion's, on the same data;
        an error whose 95 % interval reaches below that is let pass.
      success_drop: its success rate may be at most this much lower than the champion's.
    """

    error_ratio: float = Field(default=1.0, gt=0)
    success_drop: float = Field(default=0.25, ge=0, le=1)


class WorkersConfig(Part):
    """Who computes. Nothing here changes a result.

    Attributes:
      sim: workers that record episodes and score models.
      trainers: workers that train; None for one per arm.
      trainer_cpus: cores that a trainer books; 0 where it takes turns with the others.
      trainer_gpus: GPUs that a trainer books.
      cores: threads that may compute at once; None for those of this machine or of the cluster.
      start_seconds: a worker may take to start [s].
      stall_seconds: a busy worker may show no progress before it is replaced [s].
      drain_seconds: running episodes get to end when the run is asked to stop [s].
      remote_rollouts: each plan is spread over this many further workers; 0 plans in place.
      least_episodes: share of a stage's episodes that must have been recorded for the run to go on.
      least_free_gb: free disk space below which a run does not begin [GB].
    """

    sim: int = Field(default=2, ge=1)
    trainers: int | None = Field(default=None, ge=1)
    trainer_cpus: float = Field(default=0.0, ge=0)
    trainer_gpus: float = Field(default=0.0, ge=0)
    cores: int | None = Field(default=None, ge=1)
    start_seconds: float = Field(default=180.0, gt=0)
    stall_seconds: float = Field(default=300.0, gt=0)
    drain_seconds: float = Field(default=10.0, ge=0)
    remote_rollouts: int = Field(default=0, ge=0)
    least_episodes: float = Field(default=0.5, ge=0, le=1)
    least_free_gb: float = Field(default=2.0, ge=0)
