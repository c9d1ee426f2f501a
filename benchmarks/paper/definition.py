"""A table as data: robots, trajectories, models, seeds. Its cells are what is trained and measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from flywheel.dynamics.baselines.named import BASELINES
from flywheel.dynamics.baselines.weights import FITTED
from flywheel.errors import ConfigError
from flywheel.evaluation import HISTORY_SECONDS
from flywheel.quantities import Bounds, EpisodeSeconds, Name, Seed
from flywheel.registry import lookup
from flywheel.robot_link import StandInConfig
from flywheel.robots import load_robot
from flywheel.runtime.config.loading import merged, read_config
from flywheel.runtime.config.parts import SegmentName
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.workers.episode_recorder import RECORDING
from flywheel.training.baselines import FitSettings
from flywheel.truth_simulator.written import hidden_effects
from flywheel.validation import Frozen, validated

TABLES = Path(__file__).parents[2] / "pipelines" / "tables"
SIZES = ("paper", "smoke")
NETWORK = "network"
FLOORS: dict[str, Literal["random", "relaxed"]] = {  # name -> roll of the restarted rods
    "floor": "random",
    "informed_floor": "relaxed",
}
OF_METHODS = ("network", "training", "evaluate")  # parts of a run that a model may change
CONTROLLERS = ("gait:roll", "gait:cw", "gait:ccw", "random", "throw", "drop", "oracle")
Count = Annotated[int, Bounds(1, 1000)]


class Method(Frozen):
    """One model of a table.

    Attributes:
      model: "network", or a baseline (`flywheel list models`).
      fit: settings of a baseline that is fitted; None for one by its name alone.
      run: changes of the table's run for this model, e.g. {network: {chunk: 1}}.
      exact: a floor restarts the very plant of the data set; else the MJCF's.
      true_winches: commands are the winches' true rates, in training and in tests.
      simulations: data sets simulated with the commands of the recordings that are added in training.
      recordings: the recordings are in the training, too; without them a robot is tested as the first plant.
      published: robot -> numbers of a publication: position and rotation of whole trajectories, and of short
        ones.
    """

    model: Name = NETWORK
    fit: dict[Name, Any] | None = None
    run: dict[Name, Any] = Field(default={})
    exact: bool = False
    true_winches: bool = False
    simulations: Annotated[int, Bounds(0, 1000)] = 0
    recordings: bool = True
    published: dict[Name, tuple[Name, Name, Name, Name]] = Field(default={})

    @model_validator(mode="after")
    def _is_a_model(self) -> Self:
        if self.fit is not None:
            kind = lookup(FITTED, self.model, "baseline with a fit")
            validated(kind.Config, self.fit, f"{self.model} cannot be fitted so", ConfigError)
        elif self.model != NETWORK:
            lookup(BASELINES, self.model, "model of a table")
        if self.exact and self.model not in FLOORS:
            raise ValueError(f"exact is for {' and '.join(FLOORS)}, got {self.model}")
        if others := sorted(set(self.run) - set(OF_METHODS)):
            raise ValueError(
                f"run: {', '.join(others)} of a model would change nothing; of one there are "
                f"{', '.join(OF_METHODS)}, and the run of the table has the others"
            )
        if not self.recordings and (not self.simulations or self.model != NETWORK):
            raise ValueError(f"recordings=false is for a {NETWORK} with simulations of 1 or more")
        return self

    @property
    def variant(self) -> str:
        """End of the names of its snapshots."""
        beside = "with" if self.recordings else "only"
        return f"-{beside}-{self.simulations}" if self.simulations else "-rates" * self.true_winches


@dataclass(frozen=True)
class Cell:
    """One model, trained and tested on one data set with one seed."""

    robot: str
    dataset: str
    method: str
    seed: int

    @property
    def name(self) -> str:
        """Name of its files."""
        return f"{self.robot}.{self.dataset}.{self.method}.s{self.seed}"


class TableConfig(Frozen):
    """Definition of a table.

    Attributes:
      name: of the table.
      robots: robot -> controllers; each has one trajectory per repetition in each data set.
      repetitions: trajectories of each controller.
      tested: repetitions that are test data.
      validation: training trajectories per data set that only decide which step of a training is kept.
      seconds: least and largest duration of a trajectory; uniform [s].
      starts: of gaits, where the robot came to rest after a "fall" in a random orientation, or "perturbed":
        put down near the keyframe, tilted.
      real: a stand-in for a real robot, whose recordings are the only data set that is tested. The data sets
        of the run are then simulations with the commands of its training recordings.
      run: differences from the default run: the plants of the data sets, network, training, evaluation.
      fit: settings of the fits of baselines.
      methods: the models, by name.
      seeds: of trainings; the trajectories have the seed of the run.
    """

    name: SegmentName
    robots: dict[SegmentName, tuple[Name, ...]] = Field(min_length=1)
    repetitions: Count = 3
    tested: Count = 1
    validation: Count = 1
    seconds: tuple[EpisodeSeconds, EpisodeSeconds] = (30.0, 60.0)
    starts: Literal["fall", "perturbed"] = "fall"
    real: StandInConfig | None = None
    run: dict[Name, Any] = Field(default={})
    fit: FitSettings = FitSettings()
    methods: dict[SegmentName, Method] = Field(min_length=1)
    seeds: tuple[Seed, ...] = Field(default=(0,), min_length=1)

    @model_validator(mode="after")
    def _counts_each_once(self) -> Self:
        for name, values in (("seeds", self.seeds), *self.robots.items()):
            if len(set(values)) < len(values):
                raise ValueError(
                    f"{name} has a value twice, which would count double: {list(values)}"
                )
        return self

    @model_validator(mode="after")
    def _lasts_long_enough(self) -> Self:
        least, most = self.seconds
        if least > most:
            raise ValueError(f"seconds are the least and the largest; got {least:g} and {most:g}")
        for robot, method in product(self.robots, self.methods.values()):  # each has a valid run
            horizon = self.config(robot, method).evaluate.horizon_seconds
            if least < HISTORY_SECONDS + horizon:
                raise ValueError(
                    f"seconds: the shortest trajectory, {least:g} s, must have {HISTORY_SECONDS:g} s of "
                    f"history and the horizon of {horizon:g} s (run.evaluate.horizon_seconds)"
                )
        return self

    @model_validator(mode="after")
    def _can_be_made(self) -> Self:
        for robot, controllers in self.robots.items():
            if unknown := set(controllers) - set(CONTROLLERS):
                raise ValueError(
                    f"{robot} has unknown controllers {sorted(unknown)}; known: {', '.join(CONTROLLERS)}"
                )
            if (self.repetitions - self.tested) * len(controllers) <= self.validation:
                raise ValueError(
                    f"{robot}: {self.repetitions} repetitions of {len(controllers)} controllers leave none "
                    f"to learn from, with {self.tested} tested and {self.validation} for validation"
                )
            if self.real is not None:
                hidden_effects(self.real.hidden, load_robot(robot))
        if self.real is not None and self.starts != "fall":
            raise ValueError(f"starts={self.starts} is for plants; a real robot stands where it is")
        for method in self.methods.values():
            most = len(self.config(next(iter(self.robots))).datasets) if self.real else 0
            if method.simulations > most:
                raise ValueError(f"simulations: at most {most} here, got {method.simulations}")
            if (method.true_winches or method.exact) and self.real is not None:
                raise ValueError("true_winches and exact: those of a real robot are unknown")
        return self

    def config(self, robot: str, method: Method | None = None) -> RunConfig:
        """The run of a robot, or of a model on it.

        Raises:
          ConfigError: it is invalid.
        """
        values = merged(self.run, {} if method is None else method.run)
        complaint = f"The run of the table {self.name} is not valid"
        return validated(RunConfig, {**values, "model": robot}, complaint, ConfigError)

    def trajectories(self, robot: str) -> dict[str, Any]:
        """Settings that determine the trajectories of a robot, beside those of its run."""
        return {
            "seconds": self.seconds,
            "repetitions": [self.repetitions, self.tested],
            "controllers": self.robots[robot],
            "validation": self.validation,
            **({"starts": self.starts} if self.starts != "fall" else {}),
            "real": None if self.real is None else self.real.model_dump(mode="json"),
        }

    def datasets(self, robot: str) -> tuple[str, ...]:
        """Names of the data sets that are tested."""
        return (
            (RECORDING,) if self.real else tuple(data.name for data in self.config(robot).datasets)
        )

    def cells(self, parts: Sequence[str] = ()) -> list[Cell]:
        """Every cell whose name has one of the given parts, in which * stands for anything."""
        asked = (
            Cell(robot, dataset, method, seed)
            for robot in self.robots
            for dataset, seed, method in product(self.datasets(robot), self.seeds, self.methods)
        )
        return [
            cell
            for cell in asked
            if not parts or any(fnmatchcase(cell.name, f"*{part}*") for part in parts)
        ]


@cache
def table_names() -> tuple[str, ...]:
    """Names of the tables that come with Flywheel."""
    return tuple(sorted(file.stem for file in TABLES.glob("*.yaml")))


def read_table(table: str, size: str = "", overrides: Sequence[str] = ()) -> TableConfig:
    """The definition of a table.

    Args:
      table: its name, or the path of a YAML file.
      size: "paper" or "smoke", in the place of that which fits three hours of two cores.
      overrides: `key=value`.

    Raises:
      ConfigError: there is none, or it is invalid.
    """
    file = Path(table) if table.endswith((".yaml", ".yml")) else TABLES / f"{table}.yaml"
    over = [TABLES / "shared" / f"{size}.yaml"] if size else []
    return read_config(TableConfig, file, overrides, over=over)
