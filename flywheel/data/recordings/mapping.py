"""The optional YAML next to a log: names of its columns, units and axes.

columns: {time: stamp, ctrl.winch_35: motor_a, s0.x: cap0_X}   # ours: theirs
units: {time: ms, points: mm, control: cm/s, winch: mm}
axes: {x: x, y: -z, z: y}          # our z (up) is their y
dt: 0.01                           # of a log without a time column [s]
conditions: new cables, concrete floor
ignore: [battery]
repair: []                         # mask exchanged markers instead of putting them right
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from flywheel.data.recordings.sources import (
    LENGTHS,
    TIMES,
    Channel,
    Coordinate,
    FileEntry,
    LengthChannel,
    MarkerSource,
    Name,
    PoseSource,
    Radius,
    TensionChannel,
    TimeUnit,
    factor_of,
    newtons_of,
    plain,
)
from flywheel.errors import ConfigError
from flywheel.files import read_yaml, shown
from flywheel.quantities import Bounds, ControlStep
from flywheel.records import Floats
from flywheel.validation import Frozen, validated

LONGEST_WORDS = 1000  # characters of a note
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Repair = Literal["swaps"]


Jitter = Annotated[float, Bounds(0, 0.5, below=True)]


class Axes(Frozen):
    """The log's axis for each of ours; ours are right-handed with z up.

    Attributes:
      x, y, z: one of the log's, with its sign.
    """

    x: Axis = "x"
    y: Axis = "y"
    z: Axis = "z"

    @model_validator(mode="after")
    def _are_a_rotation(self) -> Self:
        if not math.isclose(np.linalg.det(self.turned(np.eye(3))), 1.0):
            raise ValueError(
                "axes must rotate the log's into ours without mirroring, each used once; got x: "
                f"{self.x}, y: {self.y}, z: {self.z}. A log with y up: x: x, y: -z, z: y"
            )
        return self

    def turned(self, points: Floats) -> Floats:
        """Points (..., 3) in our axes; the same array where they are the log's."""
        axes = (self.x, self.y, self.z)
        if axes == ("x", "y", "z"):
            return points
        signs = [-1.0 if axis.startswith("-") else 1.0 for axis in axes]
        # No matrix product: it would make a NaN of the axes beside one that is infinite.
        turned = points[..., ["xyz".index(axis[-1]) for axis in axes]]
        turned *= signs
        return turned


class Units(Frozen):
    """Units of the log's columns.

    Attributes:
      time: "s", "ms", "us", "ns", "min" or "h".
      points: "m", "cm", "mm", "in" or "ft"; or three, of the log's x, y and z.
      control: a length (for position winches), a length per second (for rate winches), or an angle
        of the drum in "rad" or "deg", or per second; with "-" in front if positive hauls in.
      winch: of measured winch positions: a length, or an angle of the drum.
      tension: of measured tensions, and of commands and positions of winches that take tensions: "N", "kN",
        "kgf" or "lbf"; with "-" in front if they are negative.
      length: of measured lengths of cables: a length.
      drum: radius of the winches' drums, if commands or positions are angles [m].
    """

    time: TimeUnit = "s"
    points: str | tuple[str, str, str] = "m"
    control: str = "m/s"
    winch: str = "m"
    tension: str = "N"
    length: str = "m"
    drum: Radius | None = None

    @model_validator(mode="after")
    def _are_known(self) -> Self:
        for name in ("control", "winch", "tension", "length"):
            self.factor(name)
        units = ", ".join(LENGTHS)
        for unit in self._of_points:
            if unit not in LENGTHS:
                raise ValueError(
                    f"units.points is one of {units}, or three of them; got {shown(unit)}"
                )
        return self

    @property
    def _of_points(self) -> tuple[str, ...]:
        return (self.points,) * 3 if isinstance(self.points, str) else self.points

    @property
    def metres(self) -> Floats:
        """(3,) factors from the log's x, y and z of points to metres."""
        return np.array([LENGTHS[unit] for unit in self._of_points])

    def factor(self, name: Literal["time", "control", "winch", "tension", "length"] | str) -> float:
        """Factor from a value of the log to s, m, m/s or N."""
        unit: str = getattr(self, name)
        if name == "tension":
            return newtons_of(unit, "units.tension")
        if name == "time":
            return TIMES[unit]
        if name != "control" and unit.endswith("/s"):
            raise ValueError(f"units.{name} is a length or an angle; got {shown(unit)}")
        return factor_of(unit, f"units.{name}", self.drum)


class RecordingMap(Frozen):
    """Mapping of a log's columns to ours; the default expects the names of the MJCF.

    Attributes:
      columns: our name -> the log's name, if different.
      units: of the log.
      axes: of the log.
      origin: the log's origin in our frame, e.g. its height above the ground [m].
      dt: time between two rows, only without a time column [s].
      conditions: free text about the circumstances.
      ignore: unused columns of the log.
      repair: "swaps": correct swapped markers; without it they are masked.
      jitter: largest distance of a stamp from the grid, as a fraction of dt.
      files: files of the recording, the first of which is the clock; by default the log itself.
      markers: tracked point -> marker of a file: its name, three columns, names of its parts, or null if it
        was not measured.
      poses: body -> its pose in a file, for the points that are not under markers.
      commands: winch -> its commands.
      winches: winch -> its measured positions; with their noise they are compared with predicted ones.
      tensions: cable -> its measured tension.
      lengths: cable -> its measured length from end to end.
    """

    columns: dict[Name, Name] = Field(default={})
    units: Units = Units()
    axes: Axes = Axes()
    origin: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    dt: ControlStep | None = None
    conditions: Annotated[str, Field(max_length=LONGEST_WORDS), AfterValidator(plain)] = ""
    ignore: tuple[Name, ...] = ()
    repair: tuple[Repair, ...] = ("swaps",)
    jitter: Jitter = 0.25
    files: tuple[FileEntry, ...] = ()
    markers: dict[Name, MarkerSource] = Field(default={})
    poses: dict[Name, PoseSource] = Field(default={})
    commands: dict[Name, Channel] = Field(default={})
    winches: dict[Name, Channel] = Field(default={})
    tensions: dict[Name, TensionChannel] = Field(default={})
    lengths: dict[Name, LengthChannel] = Field(default={})

    @model_validator(mode="after")
    def _begins_with_its_clock(self) -> Self:
        first = self.files[0] if self.files else None
        if first and (first.offset != 0 or first.pace != 1):
            raise ValueError(
                "the first file's clock is that of the recording: give offset and pace of the others"
            )
        return self

    @property
    def assembles(self) -> bool:
        """True if the map names files, markers, bodies or channels, not only columns of one table."""
        channels = self.commands or self.winches or self.tensions or self.lengths
        return bool(self.files or self.markers or self.poses or channels)


def read_map(path: Path) -> RecordingMap:
    """Read a map from a YAML file.

    Raises:
      ConfigError: it cannot be read, is not YAML, has an unknown key (the nearest is named) or a
        wrong value.
    """
    values = read_yaml(path, "map", ConfigError)
    complaint = f"{path} is not a map of a recording"
    return validated(RecordingMap, {} if values is None else values, complaint, ConfigError)
