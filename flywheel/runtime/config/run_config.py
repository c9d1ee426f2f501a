"""Everything a run is made from. Each part is owned by the package that it configures."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    BeforeValidator,
    Field,
    model_validator,
)

from flywheel.control import MppiConfig
from flywheel.dynamics.gnn import NetworkConfig
from flywheel.dynamics.plant import MeasurementModel, PlantParameters
from flywheel.effects import AdoptedPlant, WrittenTerm
from flywheel.effects.adopted import MOST_EFFECTS
from flywheel.errors import ConfigError, FlywheelError, UnknownNameError
from flywheel.files import shown
from flywheel.quantities import Bounds, Name, Place, Seed, Threads
from flywheel.registry import lookup
from flywheel.robots import TerrainConfig, load_robot
from flywheel.runtime.config.demand import problems
from flywheel.runtime.config.loading import read_config
from flywheel.runtime.config.parts import (
    CollectConfig,
    DiagnoseConfig,
    EvaluateConfig,
    GateConfig,
    Part,
    WorkersConfig,
)
from flywheel.runtime.tracking.tracker import TrackingConfig
from flywheel.tasks import TaskConfig
from flywheel.training import TrainingConfig
from flywheel.training.config import MOST_DATASETS

NETWORKS = {"lean": NetworkConfig.lean, "paper": NetworkConfig.paper}
# What may differ between a run and its continuation: it changes who computes where, not a number.
WITHOUT_EFFECT = ("name", "workers", "tracking", "store")
# Settings of earlier versions, still in the files of their runs. None of them changed a result.
RETIRED = ("workers.remote_rollouts",)


def _with_preset(network: Any) -> Any:
    """`{preset: paper, width: 128}`: one of the network's named shapes, with changes."""
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


class DataSet(Part):
    """A variation of the plant. Its place in the list is its place in the network's one-hot.

    Attributes:
      name: in an episode's provenance.
      plant: what differs from the MJCF, as factors.
    """

    name: Name = "nominal"
    plant: PlantParameters = PlantParameters()


class RunConfig(Part):
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

    name: Name = "run"
    robot: Place = "prism3"
    seed: Seed = 0
    iterations: Annotated[int, Bounds(0, 1000)] = 2
    control_arm: bool = True
    effects: tuple[WrittenTerm, ...] = Field(default=(), max_length=MOST_EFFECTS)
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
    gate: GateConfig = GateConfig()
    sim_threads: Threads = 1
    workers: WorkersConfig = WorkersConfig()
    tracking: TrackingConfig = TrackingConfig()
    store: Place = ""

    @model_validator(mode="before")
    @classmethod
    def _adopted(cls, values: Any) -> Any:
        if not isinstance(values, dict) or not isinstance(values.get("effects"), str):
            return values
        name = values.get("robot", cls.model_fields["robot"].default)
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
                f"run's robot is {wanted.name} ({wanted.digest[:12]})"
            )
        return {**values, "effects": [e.model_dump() for e in plant.effects]}

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
    def _a_diagnosis_has_recordings(self) -> Self:
        if self.diagnose.on and not self.collect.recordings:
            raise ValueError(
                "diagnose.on needs recordings of the robot: name those in the store in "
                "collect.recordings"
            )
        return self

    @model_validator(mode="after")
    def _can_be_done(self) -> Self:
        if found := problems(self):
            raise ValueError("; ".join(found))
        try:
            self.mppi.steps(self.network.dt)
        except ConfigError as error:
            raise ValueError(f"mppi.{error}") from None
        return self

    def dataset_numbers(self) -> dict[str, int]:
        """Index of each data set in the network's one-hot; recordings come last."""
        names = [data.name for data in self.datasets]
        return {name: i for i, name in enumerate(dict.fromkeys([*names, "recording"]))}


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> RunConfig:
    """Read a run's configuration from a YAML file and `key=value` arguments.

    Raises:
      ConfigError: see `loading.read_config`.
    """
    return read_config(RunConfig, path, overrides)


def load_stored_config(path: str | Path, overrides: Sequence[str] = ()) -> RunConfig:
    """Read the configuration that a run was begun with, by this or an earlier version.

    Raises:
      ConfigError: see `loading.read_config`.
    """
    return read_config(RunConfig, path, overrides, RETIRED)


def decisive(config: RunConfig) -> dict[str, Any]:
    """The part of a configuration that decides the results, as plain values."""
    values = config.model_dump(mode="json")
    return {key: value for key, value in values.items() if key not in WITHOUT_EFFECT}


def config_digest(config: RunConfig) -> str:
    """sha256 of the part of a configuration that decides the results."""
    return hashlib.sha256(json.dumps(decisive(config), sort_keys=True).encode()).hexdigest()
