"""The complete configuration of a run. Each part is owned by the package that it configures."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from flywheel.control import MppiConfig
from flywheel.dynamics.gnn import NetworkConfig
from flywheel.dynamics.plant import MeasurementModel
from flywheel.effects import NAMED, AdoptedPlant, Effect, WrittenTerm
from flywheel.effects.adopted import MOST_EFFECTS
from flywheel.effects.libraries import with_laws
from flywheel.effects.own import MOST_FILES, LawFile, check_different, check_given
from flywheel.errors import ConfigError, DataError, FlywheelError, UnknownNameError
from flywheel.evaluation.scoring import WHOLE
from flywheel.files import shown
from flywheel.quantities import Bounds, Name, Place, Seed, Threads
from flywheel.records import RECORDING
from flywheel.registry import lookup
from flywheel.robots import TerrainConfig, load_robot
from flywheel.runtime.config.demand import DISK, PREDICTED, Demand
from flywheel.runtime.config.heard import check_heard
from flywheel.runtime.config.loading import read_config
from flywheel.runtime.config.parts import (
    CollectConfig,
    DataSet,
    DiagnoseConfig,
    EvaluateConfig,
    GateConfig,
    ResidualModelConfig,
    WorkersConfig,
)
from flywheel.runtime.config.robot_config import REACHED_BY, RobotConfig
from flywheel.runtime.tracking.tracker import TrackingConfig
from flywheel.tasks import TaskConfig
from flywheel.training import TrainingConfig
from flywheel.training.config import MOST_DATASETS
from flywheel.validation import Frozen

MOST_EPISODES = 100_000  # of a run; each has its own files, and every stage lists all of them
# Estimates of memory; measured on prism3 and icosa6, for networks by counting their numbers.
EPISODE = 2e3  # for each step of an episode [bytes]
WEIGHTS = 160  # for a layer, per width squared: ten numbers, their gradients, two moments [bytes]
GRADIENT = 1.5e3  # for a prediction chunk in a layer, per width, until its gradient exists [bytes]
STARTS = 256  # short predictions that `evaluation.score` makes at a time
NETWORKS = {
    "lean": NetworkConfig.lean,
    "paper": NetworkConfig.paper,
    "hybrid": NetworkConfig.hybrid,
}
# These decide who computes where, no number. All but the store may differ when a run is continued.
MAY_DIFFER = ("name", "workers", "tracking")
WITHOUT_EFFECT = (*MAY_DIFFER, "store")
LAW_FILES = "effects_from"  # names files relative to the one that it stands in


def _with_preset(network: Any) -> Any:
    """The network of `{preset: paper, width: 128}`: one of the named shapes, with changes."""
    if not isinstance(network, dict) or "preset" not in network:
        return network
    if not isinstance(network["preset"], str):
        raise ValueError(f"preset: must be one of {', '.join(NETWORKS)}")
    changes = {key: value for key, value in network.items() if key != "preset"}
    try:
        preset = lookup(NETWORKS, network["preset"], "network preset")
    except UnknownNameError as error:
        raise ValueError(str(error)) from None
    return {**preset().model_dump(), **changes}


class RunConfig(Frozen):
    """A whole run of the flywheel.

    Attributes:
      name: for people.
      model: name of a shipped robot, or path of an MJCF: the model of the robot.
      robot: driven and measured; None to simulate the model in its place.
      seed: source of every other seed.
      iterations: after iteration 0.
      control_arm: in addition to MPPI's, train a model on as many episodes with random controls.
      effects: of every plant, beyond its MJCF. A file may give the path of an adopted plant
        instead, whose effects are then used.
      effects_from: law files with the user's own effects: Python that is run. A configuration's
        file gives their paths relative to itself; on the command line they are relative to the
        working directory.
      datasets: variations of the plant; MPPI collects and is evaluated on the first.
      measurement: between the plant and everything that learns or plans.
      terrain: ground of the episodes.
      collect, task, mppi, network, training, evaluate, diagnose, residual, gate: described in their
        own classes.
      sim_threads: threads of each simulation worker.
      workers, tracking: described in their own classes; they do not affect results.
      store: URL of the trajectory store; "" for `store/` in the run folder.
    """

    name: Name = "run"
    model: Place = "prism3"
    robot: RobotConfig | None = None
    seed: Seed = 0
    iterations: Annotated[int, Bounds(0, 1000)] = 2
    control_arm: bool = True
    effects: tuple[WrittenTerm, ...] = Field(default=(), max_length=MOST_EFFECTS)
    effects_from: tuple[LawFile, ...] = Field(default=(), max_length=MOST_FILES)
    datasets: tuple[DataSet, ...] = Field(
        default=(DataSet(),), min_length=1, max_length=MOST_DATASETS
    )
    measurement: MeasurementModel = MeasurementModel()
    terrain: TerrainConfig = TerrainConfig()
    collect: CollectConfig = CollectConfig()
    task: TaskConfig = TaskConfig()
    mppi: MppiConfig = MppiConfig()
    network: Annotated[NetworkConfig, BeforeValidator(_with_preset)] = NetworkConfig()
    training: TrainingConfig = TrainingConfig()
    evaluate: EvaluateConfig = EvaluateConfig()
    diagnose: DiagnoseConfig = DiagnoseConfig()
    residual: ResidualModelConfig = ResidualModelConfig()
    gate: GateConfig = GateConfig()
    sim_threads: Threads = 1
    workers: WorkersConfig = WorkersConfig()
    tracking: TrackingConfig = TrackingConfig()
    store: Place = ""

    @field_validator("effects_from", mode="before")
    @classmethod
    def _one_or_several(cls, files: Any) -> Any:
        return files if isinstance(files, list | tuple) else [files]

    @model_validator(mode="before")
    @classmethod
    def _model_and_effects(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        if isinstance(name := values.get("robot"), str):
            raise ValueError(
                "robot is the robot that is driven (link, hidden, ...), not an MJCF; that is model: "
                f"model={shown(name)}"
            )
        return cls._adopted(values)

    @classmethod
    def _adopted(cls, values: dict[str, Any]) -> dict[str, Any]:
        if not isinstance(values.get("effects"), str):
            return values
        name = values.get("model", cls.model_fields["model"].default)
        if not isinstance(name, str):
            return values  # which is refused for that
        try:
            plant, robot = AdoptedPlant.read(values["effects"])
            wanted = load_robot(name)
        except FlywheelError as error:
            raise ValueError(str(error)) from None
        if wanted.digest != robot.digest:
            raise ValueError(
                f"effects {values['effects']} were adopted for {robot.name} ({robot.digest[:12]}), the "
                f"run's model is {wanted.name} ({wanted.digest[:12]})"
            )
        files = cls._given(values.get("effects_from", []))
        try:
            check_given(plant.effects_from, files, f"The plant {values['effects']}")
        except FlywheelError as error:
            raise ValueError(str(error)) from None
        return {**values, "effects": [e.model_dump() for e in plant.effects], "effects_from": files}

    @classmethod
    def _given(cls, files: Any) -> list[LawFile]:
        """The value of a setting for law files: one, or a list."""
        return [LawFile.model_validate(each) for each in cls._one_or_several(files)]

    @model_validator(mode="after")
    def _law_files_have_different_names(self) -> Self:
        try:
            check_different(self.effects_from)
        except ConfigError as error:
            raise ValueError(f"effects_from: {error}") from None
        return self

    @model_validator(mode="after")
    def _known_effects(self) -> Self:
        if not self.effects_from:  # else it is asked once the files are run: `check_suits`
            try:
                self.diagnose.check_names(NAMED)
            except (DataError, UnknownNameError) as error:
                raise ValueError(f"diagnose: {error}") from None
        return self

    def library(self, base: Mapping[str, Effect] = NAMED) -> Mapping[str, Effect]:
        """A library with the effects of the law files. The files are run once in a process.

        Raises:
          ConfigError: a law file cannot be used, see `with_laws`.
        """
        return with_laws(self.effects_from, base) if self.effects_from else base

    @model_validator(mode="after")
    def _data_sets_have_names_and_places(self) -> Self:
        names = [data.name for data in self.datasets]
        if len(set(names)) < len(names):
            raise ValueError(f"data sets need different names, got {shown(names)}")
        if (places := len(self.dataset_numbers())) > self.network.datasets:
            raise ValueError(
                f"{places} data sets (recordings are one) need network.datasets >= {places}, got "
                f"{self.network.datasets}"
            )
        return self

    @model_validator(mode="after")
    def _has_one_seed(self) -> Self:
        seeds = {"training": self.training.seed, "residual.training": self.residual.training.seed}
        for name, seed in seeds.items():
            if seed:
                raise ValueError(
                    f"{name}.seed: the seeds of a run's trainings follow from its own; set seed, got {seed}"
                )
        return self

    @model_validator(mode="after")
    def _a_diagnosis_has_recordings(self) -> Self:
        if self.diagnose.on and not self.collect.recordings and self.robot is None:
            raise ValueError(
                "diagnose.on needs recordings: name those in the store in collect.recordings, or "
                "a robot that records some (robot.link)"
            )
        return self

    @model_validator(mode="after")
    def _a_residual_model_has_recordings(self) -> Self:
        if self.residual.on and self.robot is None:
            raise ValueError("residual.on needs a robot that records something: give robot.link")
        if self.robot is not None and "residual" in self.robot.planners and not self.residual.on:
            raise ValueError("robot.planners has residual, which needs residual.on=true")
        return self

    @model_validator(mode="after")
    def _can_be_done(self) -> Self:
        if found := _not_doable(self):
            raise ValueError("; ".join(found))
        try:
            self.mppi.steps(self.network.dt)
        except ConfigError as error:
            raise ValueError(f"mppi.{error}") from None
        return self

    @property
    def recording_number(self) -> int:
        """Index of recordings in the network's one-hot; 0, the first data set, for a run without any."""
        recorded = self.robot is not None or bool(self.collect.recordings)
        return self.dataset_numbers()[RECORDING] if recorded else 0

    def dataset_numbers(self) -> dict[str, int]:
        """Index of each data set in the network's one-hot; recordings come last."""
        names = [data.name for data in self.datasets]
        return {name: i for i, name in enumerate(dict.fromkeys([*names, RECORDING]))}


def load_config(path: str | Path, overrides: Sequence[str] = (), stored: bool = False) -> RunConfig:
    """Read a run's configuration from a YAML file and `key=value` arguments.

    Args:
      path: of the file.
      overrides: "a.b=value".
      stored: it is that of a run's folder, where all files that it names are.

    Raises:
      ConfigError: the file or an override cannot be read, a value is wrong, or an override has no effect.
    """
    config = read_config(RunConfig, path, overrides, beside=(LAW_FILES,), only_beside=stored)
    check_heard(config, overrides)
    return config


def decisive(config: RunConfig) -> dict[str, Any]:
    """The part of a configuration that determines the results, as plain values.

    The stand-in's physics does so, too, but is secret: only its use is included.
    """
    values = config.model_dump(mode="json")
    if config.robot is not None:
        values["robot"] = {k: v for k, v in values["robot"].items() if k not in REACHED_BY}
    return {key: value for key, value in values.items() if key not in WITHOUT_EFFECT}


def continued(stored: RunConfig, given: RunConfig) -> RunConfig:
    """The stored configuration of a run, with the parts of a given one that may differ from it."""
    parts = {name: getattr(given, name) for name in MAY_DIFFER}
    if stored.robot is not None and given.robot is not None:
        way = {name: getattr(given.robot, name) for name in REACHED_BY}
        parts["robot"] = stored.robot.model_copy(update=way)
    return stored.model_copy(update=parts)


def config_digest(config: RunConfig) -> str:
    """sha256 of the part of a configuration that determines the results."""
    return hashlib.sha256(json.dumps(decisive(config), sort_keys=True).encode()).hexdigest()


def _not_doable(config: RunConfig) -> list[str]:
    """Reasons why no machine could do the run, as sentences; empty if one could."""
    too_large = [str(demand) for demand in _demands(config) if demand.bytes > demand.most]
    return [*_too_short(config), *_too_many(config), *too_large]


def _episodes(config: RunConfig) -> dict[str, tuple[int, float]]:
    """For each setting of a duration: the number of such episodes in the whole run, and their
    length [s].
    """
    collect, evaluate = config.collect, config.evaluate
    trained = config.iterations * (1 + config.control_arm)
    driven = 1 + trained + evaluate.oracle + (1 + evaluate.oracle) * len(evaluate.unseen)
    robot = config.robot
    kinds = {
        "robot.first_seconds": (robot.first, robot.first_seconds) if robot else (0, 0.0),
        "robot.drives": (
            (1 + config.iterations) * robot.drives * len(robot.planners) if robot else 0,
            config.task.seconds,
        ),
        "collect.gait_seconds": (collect.gaits, collect.gait_seconds),
        "collect.random_seconds": (collect.random, collect.random_seconds),
        "collect.drop_seconds": (collect.drops, collect.drop_seconds),
        "collect.mppi_seconds": (trained * collect.mppi, collect.mppi_seconds),
        "task.seconds": (driven * evaluate.tasks, config.task.seconds),
    }
    return {name: kind for name, kind in kinds.items() if kind[0]}


def _too_short(config: RunConfig) -> Iterator[str]:
    dt = config.network.dt
    times = {
        **{name: seconds for name, (_, seconds) in _episodes(config).items()},
        "evaluate.horizon_seconds": config.evaluate.horizon_seconds,
        "training.validation_seconds": config.training.validation_seconds,
    }
    for name, seconds in times.items():
        if round(seconds / dt) < 1:
            yield f"{name} ({seconds:g} s) is shorter than a control step, network.dt ({dt:g} s)"


def _too_many(config: RunConfig) -> Iterator[str]:
    episodes = sum(count for count, _ in _episodes(config).values())
    if episodes > MOST_EPISODES:
        yield (
            f"the run has {episodes:,} episodes (collect, iterations, evaluate.tasks); at most "
            f"{MOST_EPISODES:,} are allowed"
        )


def _demands(config: RunConfig) -> Iterator[Demand]:
    recorded, dt = _episodes(config), config.network.dt
    network, training, evaluate = config.network, config.training, config.evaluate
    step = f"in control steps of {dt:g} s (network.dt)"
    for name, (count, seconds) in recorded.items():
        about = f"of {seconds:g} s ({name}) {step}"
        yield Demand(f"episodes {about}", EPISODE * seconds / dt)
        if evaluate.full:
            whole = PREDICTED * min(WHOLE, count) * seconds / dt
            yield Demand(f"predictions (evaluate.full) of whole episodes {about}", whole)
    everything = sum(count * seconds for count, seconds in recorded.values())
    about = f"{everything:,.0f} s of episodes (collect, iterations, evaluate.tasks) {step}"
    yield Demand(f"all {about}", EPISODE * everything / dt, DISK)

    samples = max(config.mppi.samples, config.collect.mppi_samples or 0)
    for name, number, seconds in (
        (f"{samples:,} plans (mppi.samples)", samples, config.mppi.horizon_seconds),
        ("predictions (evaluate.horizon_seconds)", STARTS, evaluate.horizon_seconds),
        (
            f"{training.validation_windows:,} predictions (training.validation_windows)",
            training.validation_windows,
            training.validation_seconds,
        ),
    ):
        yield Demand(f"{name} of {seconds:g} s {step}", PREDICTED * number * seconds / dt)

    layers = network.rounds * network.mlp_layers
    shape = f"a network of {network.rounds} rounds (network.rounds) of {network.mlp_layers} layers "
    shape += f"(network.mlp_layers) of width {network.width:,} (network.width)"
    yield Demand(f"the weights of {shape}", WEIGHTS * layers * network.width**2)
    stages = (*training.initial.stages, *training.fine_tuning.stages)
    chunks = max(
        training.chunks_per_batch, training.least_windows * max(stage.chunks for stage in stages)
    )
    batch = f"{chunks:,} chunks (training.chunks_per_batch, or least_windows of a stage's chunks)"
    yield Demand(f"batches of {batch} in {shape}", GRADIENT * chunks * layers * network.width)
