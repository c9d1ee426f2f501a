"""The robot of a run: its link, the recordings made on it, and the stand-in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from flywheel.errors import ConfigError
from flywheel.outputs import write_output
from flywheel.quantities import Bounds, Episodes, EpisodeSeconds, Name, PartialShare, Place
from flywheel.robot_link import StandInConfig
from flywheel.robot_link.opening import SIMULATED, check_way
from flywheel.run_identity import HOW
from flywheel.runtime.config.loading import read_config, yaml_of

Planner = Literal["network", "given", "plant", "residual"]
STAND_IN = frozenset(StandInConfig.model_fields)
# How a robot is reached changes no result: neither do transcripts of what it measured.
REACHED_BY = ("link", "links", "arguments")
TRANSCRIPTS = "transcripts:"
STAND_IN_FILE = "stand_in.yaml"


def write_stand_in(config: StandInConfig, folder: Path) -> None:
    """Write the stand-in's description into a file for its own process only."""
    folder.mkdir(parents=True, exist_ok=True)
    write_output(folder / STAND_IN_FILE, yaml_of(config))


def read_stand_in(folder: Path) -> StandInConfig | None:
    """The stand-in's description; None without one.

    Raises:
      ConfigError: the file was changed and is invalid, or is not whole.
    """
    path = folder / STAND_IN_FILE
    if not path.exists():
        return None
    found = read_config(StandInConfig, path)
    if missing := STAND_IN - found.model_fields_set:
        raise ConfigError(f"{path} was altered: it lacks {', '.join(sorted(missing))}. {HOW}")
    return found


class RobotConfig(StandInConfig):
    """A robot behind a link, and the recordings made on it.

    The stand-in's description (`StandInConfig`) is secret: it is in no dump of this and in no
    digest.

    Attributes:
      link: "simulated" for a stand-in in its own process, "tcp://HOST:PORT", "ros://HOST:PORT",
        "MODULE:CLASS", or "transcripts:FOLDER" for the messages on the link of an earlier run (its
        folder `robot/`).
      links: number of robots driven at once; more than one for stand-ins only.
      arguments: of a user's class.
      first: episodes recorded in iteration 0, half of them with gaits if the robot has any, the
        others with random controls.
      first_seconds: their duration [s].
      drives: episodes to goals for each planner in every iteration, with the task and the MPPI of
        the run.
      planners: models with which MPPI drives the robot: "network"; "given", the unchanged MJCF;
        "plant", the MJCF with the adopted effects; "residual", that plant with a correcting
        network.
      validation, test: fractions of the episodes of each kind that are kept for validation and for
        tests.
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
        """Description of the stand-in."""
        return StandInConfig(**{name: getattr(self, name) for name in STAND_IN})

    @model_validator(mode="after")
    def _can_be_driven(self) -> RobotConfig:
        if len(set(self.planners)) < len(self.planners):
            raise ValueError(f"planners: each at most once, got {', '.join(self.planners)}")
        replayed = self.link.startswith(TRANSCRIPTS)
        if self.links > 1 and self.link != SIMULATED and not replayed:
            raise ValueError(f"links: a robot at {self.link} is one robot, got {self.links} links")
        if not replayed:
            try:
                check_way(self.link, self.stand_in, self.arguments)
            except ConfigError as error:
                raise ValueError(f"link: {error}") from None
        return self

    @model_serializer(mode="wrap")
    def _without_secrets(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {key: value for key, value in handler(self).items() if key not in STAND_IN}

    def __repr_args__(self) -> Iterator[tuple[str | None, Any]]:
        return ((key, value) for key, value in super().__repr_args__() if key not in STAND_IN)
