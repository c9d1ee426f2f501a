"""Settings of the parts of a run that belong to no package below: data, scores, diagnosis, gate, workers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import AfterValidator, Field, StringConstraints

from flywheel.diagnosis.fitting.nuisance import unsure_terms
from flywheel.dynamics.plant import PlantParameters
from flywheel.dynamics.residual import ResidualConfig
from flywheel.effects import Effect
from flywheel.errors import FlywheelError
from flywheel.quantities import (
    Bounds,
    Episodes,
    EpisodeSeconds,
    Factor,
    HorizonSeconds,
    Name,
    PartialShare,
    Patience,
    Place,
    Samples,
    Share,
    WaitingSeconds,
)
from flywheel.registry import lookup
from flywheel.robots import load_course
from flywheel.training.residual import ResidualTraining
from flywheel.validation import Frozen

MOST_RECORDINGS = 5_000  # that one configuration may name
MOST_COURSES = 100
MOST_NAMES = 1000  # of effects that a diagnosis asks about
# The names that the store gives its segments.
SegmentName = Annotated[Name, StringConstraints(pattern=r"^[a-z0-9][a-z0-9._-]*$")]
# The most is a cluster of a hundred machines with a hundred cores each.
Workers = Annotated[int, Bounds(1, 10_000)]
Processors = Annotated[float, Bounds(0, 1000)]


def _can_be_read(courses: tuple[str, ...]) -> tuple[str, ...]:
    try:
        for course in courses:
            load_course(course)
    except FlywheelError as error:
        raise ValueError(str(error)) from None
    return courses


Courses = Annotated[tuple[Place, ...], AfterValidator(_can_be_read)]


class CollectConfig(Frozen):
    """Episodes recorded for training.

    Attributes:
      gaits, random, drops: episodes of each kind in iteration 0, spread over the data sets.
      gait_seconds, random_seconds, drop_seconds: their durations [s].
      gait_variation: largest random change of the cable lengths of a gait's targets, as a fraction
        [-]. Each gait starts where the robot came to rest after a random drop.
      mppi: episodes added by each later iteration.
      mppi_seconds: their longest duration [s].
      mppi_samples: plans that MPPI samples at a time for them; None for `mppi.samples`. Data needs
        variety, a goal the best plan.
      validation: fraction of the episodes of each kind that is kept for validation.
      test: fraction of the episodes of each kind of iteration 0 that is kept for tests.
      recordings: segments already in the store that belong to the data from iteration 0 on.
      courses: taken in turn, as in `task.course`. MPPI drives through them instead of the task; gaits,
        random controls and drops begin by one of their boxes.
    """

    gaits: Episodes = 6
    gait_seconds: EpisodeSeconds = 30.0
    gait_variation: Annotated[float, Bounds(0, 0.5)] = 0.15
    random: Episodes = 10
    random_seconds: EpisodeSeconds = 30.0
    drops: Episodes = 4
    drop_seconds: EpisodeSeconds = 5.0
    mppi: Annotated[int, Bounds(1, 10_000)] = 10
    mppi_seconds: EpisodeSeconds = 30.0
    mppi_samples: Samples | None = None
    validation: PartialShare = 0.2
    test: PartialShare = 0.2
    recordings: tuple[SegmentName, ...] = Field(default=(), max_length=MOST_RECORDINGS)
    courses: Courses = Field(default=(), max_length=MOST_COURSES)


class EvaluateConfig(Frozen):
    """Evaluation of models.

    Predictions start from the measurements. Those of a simulated episode are compared with its true states,
    those of a recording with its own measurements.

    Attributes:
      tasks: closed-loop episodes per model, each at most `task.seconds` long; the same tasks for
        every model.
      horizon_seconds: of the short-horizon errors [s].
      starts: predictions per episode, for the short-horizon errors.
      full: also predict whole episodes.
      oracle: also run the tasks with a planner that knows the plant (the ceiling).
      floor: also score the plant restarted from partial observations (the floor).
      floor_window: past steps from which the floor estimates velocities; more than 1 for noisy
        points.
      video: render one episode per iteration, and per unseen course.
      unseen: courses, as in `task.course`, that the last champion drives through at the end, once
        for each task. They are not used for training.
    """

    tasks: Episodes = 8
    horizon_seconds: HorizonSeconds = 2.0
    starts: Samples = 10
    full: bool = True
    oracle: bool = True
    floor: bool = True
    floor_window: Annotated[int, Bounds(1, 1000, "steps")] = 1
    video: bool = True
    unseen: Courses = Field(default=(), max_length=MOST_COURSES)


class DiagnoseConfig(Frozen):
    """Diagnosis of the plant with the recordings, before a run collects again.

    An effect that is found, and confirmed by the recordings that are kept for tests, is added to
    the plant. The episodes of the first iteration are then simulated again, and those of the old
    plant are excluded.

    Attributes:
      on: diagnose, from iteration 1 on.
      effects: names of the candidates; by default all of the library, and of the run's law files.
      unsure: effect -> standard deviation of the MJCF's number, see `diagnosis.fitting.nuisance`.
      seconds: largest total duration of the recordings used; the same again of those kept for tests
        [s].
      episode_seconds: longest part of each recording, from its beginning; enough recordings are
        used, spread over all of them. None for the first recordings as a whole [s].
      window_seconds: length of the windows [s]; None for a length that suits the robot.
    """

    on: bool = False
    effects: tuple[Name, ...] = Field(default=(), max_length=MOST_NAMES)
    unsure: dict[Name, Factor] = Field(default_factory=dict, max_length=MOST_NAMES)
    seconds: HorizonSeconds = 12.0
    episode_seconds: HorizonSeconds | None = None
    window_seconds: HorizonSeconds | None = None

    def check_names(self, library: Mapping[str, Effect]) -> None:
        """Check the names of effects, and those given as uncertain.

        Raises:
          UnknownNameError, DataError: the message says which, and lists the known ones.
        """
        for name in self.effects:
            lookup(library, name, "effect")
        unsure_terms(self.unsure, library=library)


class ResidualModelConfig(Frozen):
    """Training of a small network on the plant's residual in the recordings (`flywheel correct`).

    Attributes:
      on: train one in every iteration, on the plant with the effects adopted so far.
      network: its shape.
      training: its settings; its seed is derived from that of the run.
    """

    on: bool = False
    network: ResidualConfig = ResidualConfig()
    training: ResidualTraining = ResidualTraining()


class GateConfig(Frozen):
    """Conditions for a new champion.

    Attributes:
      error_ratio: the new model's validation error may be at most this times the champion's on the same
        data. The lower end of the ratio's 95 % interval counts.
      success_drop: the new model's success rate may be at most this much lower than the champion's.
    """

    error_ratio: Factor = 1.0
    success_drop: Share = 0.25


class WorkersConfig(Frozen):
    """The worker processes. These settings do not affect results.

    Attributes:
      sim: workers that record episodes and score models.
      trainers: workers that train; None for one per arm.
      trainer_cpus: cores that a trainer books; 0 if it takes turns with the other workers.
      trainer_gpus: GPUs that a trainer books.
      cores: threads that may compute at once; None for all cores of this machine or of the cluster.
      start_seconds: longest start of a worker [s].
      stall_seconds: longest time without progress before a busy worker is replaced [s].
      drain_seconds: time for running episodes to end when the run is asked to stop [s].
      least_episodes: fraction of a stage's episodes that must be recorded for the run to continue.
      least_free_gb: free disk space required at the start of a run [GB].
    """

    sim: Workers = 2
    trainers: Workers | None = None
    trainer_cpus: Processors = 0.0
    trainer_gpus: Processors = 0.0
    cores: Workers | None = None
    start_seconds: Patience = 180.0
    stall_seconds: Patience = 300.0
    drain_seconds: WaitingSeconds = 10.0
    least_episodes: Share = 0.5
    least_free_gb: Annotated[float, Bounds(0, 1e9, "GB")] = 2.0


class DataSet(Frozen):
    """A variation of the plant. Its index in the list is its index in the network's one-hot.

    Attributes:
      name: in an episode's provenance.
      plant: differences from the MJCF, as factors.
    """

    name: Name = "nominal"
    plant: PlantParameters = PlantParameters()
