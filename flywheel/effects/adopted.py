"""Adopted plants: an MJCF and the effects that were found missing in it, in a folder, numbered."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flywheel.effects.effect import Effect, Terms
from flywheel.effects.written import WrittenTerm
from flywheel.errors import ConfigError, RobotError
from flywheel.robots import Robot

PLANT, MJCF = "plant.yaml", "robot.xml"


class AdoptedPlant(BaseModel):
    """A version of a robot's plant.

    Nothing of an earlier version is changed: to go back is to use its folder again.

    Attributes:
      robot: the robot's name.
      digest: of its MJCF (`Robot.digest`).
      version: 1 for the first that was adopted.
      parent: sha256 of the file of the version before; "" for the MJCF alone.
      effects: all that the plant has beyond its MJCF.
      evidence: what the effects rest on: verdict, recordings, errors, intervals.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: str
    digest: str
    version: int = Field(ge=1)
    parent: str = ""
    effects: tuple[WrittenTerm, ...] = Field(min_length=1)
    evidence: dict[str, Any] = Field(default_factory=dict)

    @classmethod
    def read(cls, path: str | Path) -> tuple[Self, Robot]:
        """An adopted plant's file, or the folder it is in, and the robot.

        Raises:
          ConfigError: no such file, or not an adopted plant.
          RobotError: the MJCF beside it is not the one that it was adopted for.
        """
        path = Path(path)
        path = path / PLANT if path.is_dir() else path
        try:
            plant = cls.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            raise ConfigError(f"There is no adopted plant {path}.") from None
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path} is not a YAML file: {error}") from None
        except ValidationError as error:
            problems = "; ".join(
                f"{'.'.join(map(str, e['loc'])) or 'the whole'}: {e['msg']}" for e in error.errors()
            )
            raise ConfigError(f"{path} is not an adopted plant: {problems}.") from None
        robot = Robot.from_mjcf(path.parent / MJCF)
        if robot.digest != plant.digest:
            raise RobotError(
                f"{path.parent / MJCF} has digest {robot.digest[:12]}, the effects in {path} were "
                f"found for {plant.digest[:12]}: sizes mean nothing on another robot."
            )
        return plant, robot

    def write(self, parent: str | Path, robot: Robot) -> Path:
        """Write it into `parent/<robot>-<version>`, which must not be there yet, and return its file.

        Raises:
          ConfigError: the folder is there.
        """
        folder = Path(parent) / f"{self.robot}-{self.version}"
        if folder.exists():
            raise ConfigError(f"{folder} is there already: versions are never written over.")
        Path(parent).mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=parent, prefix=".adopting-") as temporary:
            draft = Path(temporary) / folder.name
            draft.mkdir()
            (draft / MJCF).write_text(robot.xml, encoding="utf-8")
            text = yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False, width=100)
            (draft / PLANT).write_text(text, encoding="utf-8")
            draft.rename(folder)
        return folder / PLANT

    def terms(self, robot: Robot, library: Mapping[str, Effect]) -> Terms:
        """The effects of a library, with their values.

        Raises:
          UnknownNameError, ConfigError: see `WrittenTerm.term`.
        """
        return tuple(effect.term(robot, library) for effect in self.effects)


def file_digest(path: str | Path) -> str:
    """sha256 of a file."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def next_version(parent: str | Path, robot: Robot) -> int:
    """One more than the highest version of the robot's plants in a folder."""
    found = Path(parent).glob(f"{robot.name}-*/{PLANT}")
    numbers = [path.parent.name.removeprefix(f"{robot.name}-") for path in found]
    return 1 + max((int(number) for number in numbers if number.isdecimal()), default=0)
