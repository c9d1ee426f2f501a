"""The optional YAML beside a log: what its columns are called, in which units and axes.

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
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from flywheel.errors import ConfigError
from flywheel.records import Floats

TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
ANGLES = {"rad": 1.0, "deg": math.pi / 180}  # of a winch's drum
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Repair = Literal["swaps"]


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Axes(_Frozen):
    """Which of the log's axes each of ours is; ours are right-handed with z up.

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
                f"axes must turn the log's into ours without mirroring, each used once; got x: "
                f"{self.x}, y: {self.y}, z: {self.z}. A log with y up: x: x, y: -z, z: y"
            )
        return self

    def turned(self, points: Floats) -> Floats:
        """Points (..., 3) in our axes."""
        axes = (self.x, self.y, self.z)
        signs = [-1.0 if axis.startswith("-") else 1.0 for axis in axes]
        # No matrix product: it would make a NaN of the axes beside one that is infinite.
        return np.asarray(points[..., ["xyz".index(axis[-1]) for axis in axes]] * signs)


class Units(_Frozen):
    """Units of the log's columns.

    Attributes:
      time: "s", "ms", "us" or "ns".
      points: "m", "cm", "mm", "in" or "ft".
      control: a length (for winches told a position), a length per second (for those told a rate),
        or an angle of the drum in "rad" or "deg", or per second; with "-" in front where positive
        hauls in.
      winch: of measured winch positions: a length, or an angle of the drum.
      drum: radius of the winches' drums, where commands or positions are angles [m].
    """

    time: Literal["s", "ms", "us", "ns"] = "s"
    points: Literal["m", "cm", "mm", "in", "ft"] = "m"
    control: str = "m/s"
    winch: str = "m"
    drum: float | None = Field(default=None, gt=0, allow_inf_nan=False)

    @model_validator(mode="after")
    def _are_known(self) -> Self:
        for name in ("control", "winch"):
            self.factor(name)
        return self

    def factor(self, name: Literal["time", "points", "control", "winch"] | str) -> float:
        """What a value of the log is multiplied by to be in s, m or m/s."""
        unit: str = getattr(self, name)
        if name in ("time", "points"):
            return {**TIMES, **LENGTHS}[unit]
        base = unit.removesuffix("/s") if name == "control" else unit
        sign, base = (-1.0, base[1:]) if base.startswith("-") else (1.0, base)
        if base in LENGTHS:
            return sign * LENGTHS[base]
        if base not in ANGLES:
            allowed = ", ".join([*LENGTHS, *ANGLES])
            per = ", each also per second (mm/s)" if name == "control" else ""
            raise ValueError(f"units.{name} is one of {allowed}{per}; got {unit!r}")
        if self.drum is None:
            raise ValueError(f"units.{name} {unit!r} is an angle: give units.drum, its radius [m]")
        return sign * ANGLES[base] * self.drum


class RecordingMap(_Frozen):
    """How a log's columns become ours; the default takes them as they are named after the MJCF.

    Attributes:
      columns: our name -> the log's name, where they differ.
      units: of the log.
      axes: of the log.
      origin: where the log's origin is in ours, e.g. its height above the ground [m].
      dt: time between two rows, only where the log has no time column [s].
      conditions: what was special about this day, in free words.
      ignore: columns of the log that are not needed.
      repair: "swaps": put exchanged markers right again; without it they are masked.
      jitter: how far a stamp may be off the grid and still count as on it, as a share of dt.
    """

    columns: dict[str, str] = {}
    units: Units = Units()
    axes: Axes = Axes()
    origin: tuple[FiniteFloat, FiniteFloat, FiniteFloat] = (0.0, 0.0, 0.0)
    dt: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    conditions: str = ""
    ignore: tuple[str, ...] = ()
    repair: tuple[Repair, ...] = ("swaps",)
    jitter: float = Field(default=0.25, ge=0.0, lt=0.5)


def read_map(path: Path) -> RecordingMap:
    """Read a map from a YAML file.

    Raises:
      ConfigError: no such file, not YAML, an unknown key (the nearest is named) or a wrong value.
    """
    try:
        values = yaml.safe_load(path.read_text())
    except FileNotFoundError:
        raise ConfigError(f"There is no map {path}.") from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"{path} is not a YAML file: {error}") from None
    try:
        return RecordingMap.model_validate({} if values is None else values)
    except ValidationError as error:
        problems = "\n".join(f"  {_explained(e)}" for e in error.errors())
        raise ConfigError(f"{path} is not a map of a recording:\n{problems}") from None


def _explained(error: Any) -> str:
    where = ".".join(str(part) for part in error["loc"]) or "(the whole)"
    if error["type"] != "extra_forbidden":
        return f"{where}: {error['msg']}; got {error['input']!r}."
    parts: dict[str, type[BaseModel]] = {"units": Units, "axes": Axes}
    owner = parts.get(str(error["loc"][0]), RecordingMap) if len(error["loc"]) > 1 else RecordingMap
    allowed = list(owner.model_fields)
    near = get_close_matches(str(error["loc"][-1]), allowed, n=1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    return f"{where}: unknown key.{hint} Allowed: {', '.join(allowed)}."
