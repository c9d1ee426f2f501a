"""Adopted plants: an MJCF and the effects identified as missing in it, in numbered folders."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Self

from pydantic import Field

from flywheel.effects.effect import Effect, Terms
from flywheel.effects.own import MOST_FILES, LawFile, LawReference, check_given, law_file, law_files
from flywheel.effects.written import WrittenTerm
from flywheel.errors import ConfigError, RobotError
from flywheel.files import file_name, parsed_yaml, read_yaml, yaml_text
from flywheel.quantities import Bounds, Name
from flywheel.robots import Robot, read_robot
from flywheel.validation import Frozen, validated

PLANT, MJCF = "plant.yaml", "robot.xml"
MOST_EFFECTS = 1000  # a robot of 100 cables with ten effects on each
MOST_EVIDENCE = 100  # kinds of evidence


class AdoptedPlant(Frozen):
    """A version of a robot's plant.

    Earlier versions are never changed: to go back, use their folder again.

    Attributes:
      robot: the robot's name.
      digest: of its MJCF (`Robot.digest`).
      version: 1 for the first adopted one.
      parent: sha256 of the previous version's file; "" for the MJCF alone.
      effects: all effects beyond the MJCF.
      effects_from: the law files of some of them.
      evidence: source of the effects: verdict, recordings, errors, intervals.
    """

    robot: Name
    digest: Name
    version: Annotated[int, Bounds(1, 1_000_000_000)]
    parent: Name = ""
    effects: tuple[WrittenTerm, ...] = Field(min_length=1, max_length=MOST_EFFECTS)
    effects_from: tuple[LawReference, ...] = Field(default=(), max_length=MOST_FILES)
    evidence: dict[Name, Any] = Field(default_factory=dict, max_length=MOST_EVIDENCE)

    @classmethod
    def read(cls, path: str | Path) -> tuple[Self, Robot]:
        """An adopted plant's file, or the folder it is in, and the robot.

        Raises:
          ConfigError: no such file, or not an adopted plant.
          RobotError: the MJCF next to it is not the one of the adoption.
        """
        path = plant_file(path)
        values = read_yaml(path, "adopted plant", ConfigError)
        plant = validated(cls, values, f"{path} is not an adopted plant", ConfigError)
        robot = read_robot(path.parent / MJCF)
        if robot.digest != plant.digest:
            raise RobotError(
                f"{path.parent / MJCF} has digest {robot.digest[:12]}, the effects in {path} were "
                f"found for {plant.digest[:12]}: sizes are meaningless on another robot."
            )
        return plant, robot

    @property
    def label(self) -> str:
        """For people, and the name of its folder: "prism3-1"."""
        return f"{_prefix(self.robot)}{self.version}"

    def write(self, parent: str | Path, robot: Robot, laws: Iterable[LawFile] = ()) -> Path:
        """Write it into `parent/<robot>-<version>`, which must not exist yet, and return its file.

        Args:
          parent: folder of the versions.
          robot: whose MJCF is written next to it.
          laws: files to copy into the folder, so that they are not lost.

        Raises:
          ConfigError: the folder exists, or cannot be made; the evidence is nested too deeply to be
            read again.
        """
        folder = Path(parent) / self.label
        try:
            if folder.exists():
                raise ConfigError(f"{folder} exists already: versions are never overwritten.")
            Path(parent).mkdir(parents=True, exist_ok=True)
            with TemporaryDirectory(dir=parent, prefix=".adopting-") as temporary:
                draft = Path(temporary) / folder.name
                draft.mkdir()
                (draft / MJCF).write_text(robot.xml, encoding="utf-8")
                for law in laws:
                    (draft / law.file).write_text(law.text, encoding="utf-8", newline="")
                without = set() if self.effects_from else {"effects_from"}
                text = yaml_text(self.model_dump(mode="json", exclude=without))
                parsed_yaml(text, "The adopted plant", ConfigError)  # as it will be read
                (draft / PLANT).write_text(text, encoding="utf-8")
                draft.rename(folder)
        except OSError as error:
            raise ConfigError(f"{folder} cannot be written: {error.strerror}.") from None
        return folder / PLANT

    def terms(self, robot: Robot, library: Mapping[str, Effect]) -> Terms:
        """The effects of a library, with their values.

        Raises:
          ConfigError: a law file of the plant is missing in the library, or differs.
          UnknownNameError, ConfigError: see `WrittenTerm.term`.
        """
        check_given(self.effects_from, law_files(library.values()), f"The plant {self.label}")
        terms = tuple(effect.term(robot, library) for effect in self.effects)
        known = {reference.sha256 for reference in self.effects_from}
        for term in terms:
            file = law_file(term.effect)
            if file is not None and file.sha256 not in known:
                raise ConfigError(
                    f"The plant {self.label} has an effect {term.effect.name}, but does not name "
                    f"the file {file} as its source."
                )
        return terms


def plant_file(path: str | Path) -> Path:
    """The file of an adopted plant, given the file itself or its folder."""
    path = Path(path)
    with suppress(OSError, ValueError):  # no name that a file can have: reading it says so
        if path.is_dir():
            return path / PLANT
    return path


def next_version(parent: str | Path, robot: Robot) -> int:
    """One more than the highest version of the robot's plants in a folder, whatever is in it."""
    prefix = _prefix(robot.name)
    numbers = [path.name.removeprefix(prefix) for path in Path(parent).glob(f"{prefix}*")]
    return 1 + max((int(number) for number in numbers if _NUMBER.fullmatch(number)), default=0)


_NUMBER = re.compile(r"[0-9]{1,8}")


def _prefix(robot: str) -> str:
    """Common prefix of the folders of a robot's plants."""
    return f"{file_name(robot)}-"
