"""The robot of a run: how it is reached, what is recorded on it, and what a stand-in for one is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from flywheel.outputs import write_output
from flywheel.quantities import Bounds, Episodes, EpisodeSeconds, Name, PartialShare, Place
from flywheel.robot_link import StandInConfig
from flywheel.robot_link.opening import SIMULATED
from flywheel.runtime.config.loading import read_config, yaml_of

Planner = Literal["network", "given", "plant", "residual"]
STAND_IN = frozenset(StandInConfig.model_fields)
# How a robot is reached changes no result: neither do transcripts of what it measured.
REACHED_BY = ("link", "links", "arguments")
TRANSCRIPTS = "transcripts:"
STAND_IN_FILE = "stand_in.yaml"


def write_stand_in(config: StandInConfig, folder: Path) -> None:
    """Write down what a stand-in is, for the one that drives it and for nobody else."""
    folder.mkdir(parents=True, exist_ok=True)
    write_output(folder / STAND_IN_FILE, yaml_of(config))


def read_stand_in(folder: Path) -> StandInConfig | None:
    """What a stand-in is; None if nothing says so.

    Raises:
      ConfigError: the file was changed so that it is none.
    """
    path = folder / STAND_IN_FILE
    return read_config(StandInConfig, path) if path.exists() else None


class RobotConfig(StandInConfig):
    """A robot that is driven through a link, and what is recorded on it.

    What a stand-in is (`StandInConfig`) is told to nobody else: it is in no dump of this and in no digest.

    Attributes:
      link: "simulated" for a stand-in in a process of its own, "tcp://HOST:PORT", "ros://HOST:PORT",
        "MODULE:CLASS", or
        "transcripts:FOLDER" for what went over the link of an earlier run (its folder `robot/`).
      links: how many are driven at once; only stand-ins are as many as one wants.
      arguments: of a class of one's own.
      first: episodes that are recorded in iteration 0, half of them with gaits where the robot has some,
        the others with random controls.
      first_seconds: their duration [s].
      drives: episodes to goals that each planner drives in every iteration, with the task and the MPPI of
        the run.
      planners: models that MPPI drives the robot with: "network"; "given", the MJCF as it is; "plant",
        the MJCF with the effects that were adopted; "residual", that plant with a network that corrects it.
      validation, test: shares of the episodes of each kind that are kept for validation and for tests.
    """

    link: Place = SIMULATED
    links: Annotated[int, Bounds(1, 64)] = 1
    arguments: dict[Name, Place] = Field(default_factory=dict, max_length=50)
    first: Episodes = 8
    first_seconds: EpisodeSeconds = 10.0
    drives: Episodes = 8
    planners: tuple[Planner, ...] = Field(default=("network", "plant"), min_length=1, max_length=4)
    validation: PartialShare = 0.15
    test: PartialShare = 0.25

    @property
    def stand_in(self) -> StandInConfig:
        """What the stand-in is."""
        return StandInConfig(**{name: getattr(self, name) for name in STAND_IN})

    @property
    def public(self) -> RobotConfig:
        """The same without what only the stand-in may know."""
        return RobotConfig.model_validate(self.model_dump())

    @model_validator(mode="after")
    def _can_be_driven(self) -> RobotConfig:
        if len(set(self.planners)) < len(self.planners):
            raise ValueError(f"planners: each at most once, got {', '.join(self.planners)}")
        replayed = self.link.startswith(TRANSCRIPTS)
        if self.links > 1 and self.link != SIMULATED and not replayed:
            raise ValueError(f"links: a robot at {self.link} is one robot, got {self.links} links")
        if self.link != SIMULATED and not replayed and self.stand_in != StandInConfig():
            raise ValueError(
                f"link: what a stand-in is ({', '.join(sorted(STAND_IN))}) goes with simulated, got "
                f"{self.link!r}"
            )
        return self

    @model_serializer(mode="wrap")
    def _without_secrets(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: value for key, value in handler(self).items() if key not in STAND_IN}

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        return ((key, value) for key, value in super().__repr_args__() if key not in STAND_IN)
