"""Everything a run is made from. Each part is owned by the package that it configures."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    field_validator,
    model_validator,
)

from flywheel.control import MppiConfig
from flywheel.diagnosis.calibration import unsure_terms
from flywheel.dynamics.gnn import NetworkConfig
from flywheel.dynamics.plant import MeasurementModel, PlantParameters
from flywheel.effects import NAMED, AdoptedPlant, WrittenTerm
from flywheel.errors import DataError, FlywheelError, UnknownNameError
from flywheel.registry import lookup
from flywheel.robots import TerrainConfig, load_robot
from flywheel.runtime.config_files import read_config
from flywheel.runtime.tracker import TrackingConfig
from flywheel.tasks import TaskConfig
from flywheel.training import TrainingConfig

NETWORKS = {"lean": NetworkConfig.lean, "paper": NetworkConfig.paper}
SHARE = Field(default=0.2, ge=0.0, lt=1.0)
# What may differ between a run and its continuation: it changes who computes where, not a number.
WITHOUT_EFFECT = ("name", "workers", "tracking", "store")


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


def _with_preset(network: Any) -> Any:
    """`{preset: paper, width: 128}`: one of the network's named shapes, with changes."""
    if not isinstance(network, dict) or "preset" not in network:
        return network
    changes = {key: value for key, value in network.items() if key != "preset"}
    try:
        preset = lookup(NETWORKS, network["preset"], "network preset")
    except UnknownNameError as error:
        raise ValueError(str(error)) from None
    return {**preset().model_dump(), **changes}


class DataSet(_Frozen):
    """A variation of the plant. Its place in the list is its place in the network's one-hot.

    Attributes:
      name: in an episode's provenance.
      plant: what differs from the MJCF, as factors.
    """

    name: str = "nominal"
    plant: PlantParameters = PlantParameters()


class CollectConfig(_Frozen):
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


class EvaluateConfig(_Frozen):
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
      video: render one episode per iteration.
    """

    tasks: int = Field(default=8, ge=0)
    horizon_seconds: float = Field(default=2.0, gt=0)
    starts: int = Field(default=10, ge=1)
    full: bool = True
    oracle: bool = True
    floor: bool = True
    floor_window: int = Field(default=1, ge=1)
    video: bool = True


class DiagnoseConfig(_Frozen):
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


class GateConfig(_Frozen):
    """When a new model replaces the champion.

    Attributes:
      error_ratio: its validation error may be at most this times the champion's, on the same data;
        an error whose 95 % interval reaches below that is let pass.
      success_drop: its success rate may be at most this much lower than the champion's.
    """

    error_ratio: float = Field(default=1.0, gt=0)
    success_drop: float = Field(default=0.25, ge=0, le=1)


class WorkersConfig(_Frozen):
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


class RunConfig(_Frozen):
    """A whole run of the flywheel.

    Attributes:
      name: for people.
      robot: name of a shipped robot, or path of an MJCF.
      seed: that every other seed is derived from.
      iterations: after iteration 0.
      control_arm: beside MPPI's, train a model on as many episodes with random controls.
      effects: what every plant has beyond the MJCF; in a file also the path of an adopted plant, whose
        effects are then taken over.
      datasets: variations of the plant; MPPI collects and is judged on the first.
      measurement: between the plant and everything that learns or plans.
      terrain: that episodes are recorded on.
      collect, task, mppi, network, training, evaluate, diagnose, gate: see each.
      sim_threads: of each sim worker.
      workers, tracking: see each; change no result.
      store: URL of the trajectory store; "" for `store/` in the run folder.
    """

    name: str = "run"
    robot: str = "prism3"
    seed: int = Field(default=0, ge=0)
    iterations: int = Field(default=2, ge=0)
    control_arm: bool = True
    effects: tuple[WrittenTerm, ...] = ()
    datasets: tuple[DataSet, ...] = Field(default=(DataSet(),), min_length=1)
    measurement: MeasurementModel = MeasurementModel()
    terrain: TerrainConfig = TerrainConfig()
    collect: CollectConfig = CollectConfig()
    task: TaskConfig = TaskConfig()
    mppi: MppiConfig = MppiConfig()
    network: Annotated[NetworkConfig, BeforeValidator(_with_preset)] = NetworkConfig()
    training: TrainingConfig = TrainingConfig()
    evaluate: EvaluateConfig = EvaluateConfig()
    diagnose: DiagnoseConfig = DiagnoseConfig()
    gate: GateConfig = GateConfig()
    sim_threads: int = Field(default=1, ge=1)
    workers: WorkersConfig = WorkersConfig()
    tracking: TrackingConfig = TrackingConfig()
    store: str = ""

    @model_validator(mode="before")
    @classmethod
    def _adopted(cls, values: Any) -> Any:
        if not isinstance(values, dict) or not isinstance(values.get("effects"), str):
            return values
        try:
            plant, robot = AdoptedPlant.read(values["effects"])
            wanted = load_robot(values.get("robot", cls.model_fields["robot"].default))
        except FlywheelError as error:
            raise ValueError(str(error)) from None
        if wanted.digest != robot.digest:
            raise ValueError(
                f"effects {values['effects']} were adopted for {robot.name} ({robot.digest[:12]}), the "
                f"run's robot is {wanted.name} ({wanted.digest[:12]})"
            )
        return {**values, "effects": [e.model_dump() for e in plant.effects]}

    @model_validator(mode="after")
    def _data_sets_have_names_and_places(self) -> Self:
        names = [data.name for data in self.datasets]
        if len(set(names)) < len(names):
            raise ValueError(f"data sets need different names, got {names}")
        if (places := len(self.dataset_numbers())) > self.network.datasets:
            raise ValueError(
                f"{places} data sets (recordings are one) need network.datasets >= {places}, got "
                f"{self.network.datasets}"
            )
        return self

    @model_validator(mode="after")
    def _a_diagnosis_has_recordings(self) -> Self:
        if self.diagnose.on and not self.collect.recordings:
            raise ValueError(
                "diagnose.on needs recordings of the robot: name those in the store in "
                "collect.recordings"
            )
        return self

    def dataset_numbers(self) -> dict[str, int]:
        """Index of each data set in the network's one-hot; recordings come last."""
        names = [data.name for data in self.datasets]
        return {name: i for i, name in enumerate(dict.fromkeys([*names, "recording"]))}


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> RunConfig:
    """Read a run's configuration from a YAML file and `key=value` arguments.

    Raises:
      ConfigError: see `config_files.read_config`.
    """
    return read_config(RunConfig, path, overrides)


def decisive(config: RunConfig) -> dict[str, Any]:
    """The part of a configuration that decides the results, as plain values."""
    values = config.model_dump(mode="json")
    return {key: value for key, value in values.items() if key not in WITHOUT_EFFECT}


def config_digest(config: RunConfig) -> str:
    """sha256 of the part of a configuration that decides the results."""
    return hashlib.sha256(json.dumps(decisive(config), sort_keys=True).encode()).hexdigest()
