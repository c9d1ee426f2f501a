"""Parts of the map that say where, in which file and how, a log has a robot's points and winches."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import partial
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator

from flywheel.data.recordings.formats import FORMATS
from flywheel.files import is_plain, shown
from flywheel.quantities import NOISE, Bounds
from flywheel.validation import Frozen

TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
FORCES = {"N": 1.0, "kN": 1e3, "kgf": 9.80665, "gf": 9.80665e-3, "lbf": 4.4482216152605}
LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
ANGLES = {"rad": 1.0, "deg": math.pi / 180, "turn": 2 * math.pi}  # of a winch's drum
TICKS = "ticks"  # of an encoder, so many per turn of the drum
QUANTITY = re.compile(r"\s*([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)\s*(?:/\s*turn|([A-Za-z]*))\s*")
HOLD = "hold"
LONGEST_NAME = 200  # characters of a column's name
TimeUnit = Literal["s", "ms", "us", "ns", "min", "h"]


def plain(text: str) -> str:
    """The text, if it can be shown to people; else a ValueError."""
    if not is_plain(text):
        raise ValueError(f"control characters are not allowed; got {shown(text)}")
    return text


def _metres(value: Any) -> Any:
    """A length in metres, of a number or a text such as `12.7 mm`."""
    found = QUANTITY.fullmatch(value) if isinstance(value, str) else None
    if found is None:
        return value
    if (found[2] or "m") not in LENGTHS:
        raise ValueError(f"a length is in {', '.join(LENGTHS)}; got {shown(value)}")
    return float(found[1]) * LENGTHS[found[2] or "m"]


def _noise(units: Mapping[str, float], value: Any) -> Any:
    """Metres or newtons, of a number or a text such as `0.2 mm` or `0.5 N`, in one of the units."""
    found = QUANTITY.fullmatch(value) if isinstance(value, str) else None
    if found is None or not found[2]:
        return value
    if found[2] not in units:
        raise ValueError(f"noise is in {', '.join(units)}; got {shown(value)}")
    return float(found[1]) * units[found[2]]


def _per_turn(value: Any) -> Any:
    """Ticks per turn, of a number or a text such as `4096 / turn`."""
    found = QUANTITY.fullmatch(value) if isinstance(value, str) else None
    return value if found is None or found[2] else float(found[1])


Name = Annotated[str, Field(max_length=LONGEST_NAME), AfterValidator(plain)]
Coordinate = Annotated[float, Bounds(-1e8, 1e8, "m")]  # positions anywhere on Earth are smaller
Radius = Annotated[float, Bounds(1e-4, 100, "m"), BeforeValidator(_metres)]  # of a drum
Length = Annotated[Coordinate, BeforeValidator(_metres)]
Noise = Annotated[float, NOISE, BeforeValidator(partial(_noise, LENGTHS | FORCES))]
PerTurn = Annotated[float, Bounds(1e-3, 1e9), BeforeValidator(_per_turn)]
Triple = tuple[Length, Length, Length]
Chosen = Annotated[float, Bounds(-1e15, 1e15)]  # by which rows are chosen; counters stay whole
Part = Annotated[float, Bounds(-1.01, 1.01)]  # of a unit quaternion


def factor_of(unit: str, what: str, drum: float | None, per: float | None = None) -> float:
    """Factor from a value in a unit to m or m/s.

    Args:
      unit: a length or an angle of the drum, also per second, with "-" in front if positive hauls in.
      what: the setting, for messages.
      drum: radius of the drum [m].
      per: ticks of an encoder per turn of the drum.

    Raises:
      ValueError: the unit is unknown, or lacks the drum's radius or the ticks per turn.
    """
    sign, base = (-1.0, unit[1:]) if unit.startswith("-") else (1.0, unit)
    base = base.removesuffix("/s")
    if base in LENGTHS:
        return sign * LENGTHS[base]
    if base not in ANGLES and base != TICKS:
        allowed = ", ".join([*LENGTHS, *ANGLES, TICKS])
        raise ValueError(
            f"{what} is one of {allowed}, rates of commands also per second (mm/s); got {shown(unit)}"
        )
    if drum is None:
        drum_of = "units.drum" if what.startswith("units.") else "drum"
        raise ValueError(f"{what} {unit!r} is an angle: give {drum_of}, its radius [m]")
    if base != TICKS:
        return sign * ANGLES[base] * drum
    if per is None:
        raise ValueError(f"{what} {unit!r} needs per: the ticks of one turn of the drum")
    return sign * 2 * math.pi * drum / per


def newtons_of(unit: str, what: str) -> float:
    """Newtons per unit of a tension.

    Args:
      unit: a force, with "-" in front if the log's tensions are negative.
      what: the setting, for messages.

    Raises:
      ValueError: the unit is unknown.
    """
    sign, base = (-1.0, unit[1:]) if unit.startswith("-") else (1.0, unit)
    if base not in FORCES:
        raise ValueError(f"{what} is one of {', '.join(FORCES)}; got {shown(unit)}")
    return sign * FORCES[base]


class _Sourced(Frozen):
    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


class FileEntry(Frozen):
    """One of the files of a recording.

    Attributes:
      path: relative to the map.
      format: its format; told by the content if missing.
      columns: names of the columns of a table without a header.
      time: name of the column of times, several if the file has tables of different rates.
      unit: of the times; dates need none.
      rate: rows per second of a file without times [Hz].
      where: only rows with these values, by the columns' names: {episode_index: 3}.
      offset: time of the first file at this file's time 0 [s].
      pace: seconds of the first file per second of this one.
      align: auto: offset and pace are found from what this file and another have seen, the winches and the
        points.
    """

    path: Name
    format: str | None = None
    columns: tuple[Name, ...] = ()
    time: Name | tuple[Name, ...] = ()
    unit: TimeUnit | None = None
    rate: Annotated[float, Bounds(1e-3, 1e6, "Hz")] | None = None
    where: dict[Name, Chosen | Name] = Field(default={})
    offset: Annotated[float, Bounds(-1e11, 1e11, "s")] = 0.0
    pace: Annotated[float, Bounds(0.5, 2)] = 1.0
    align: Literal["auto"] | None = None

    @model_validator(mode="after")
    def _is_known(self) -> Self:
        known = [*FORMATS, "table"]
        if self.format is not None and self.format not in known:
            raise ValueError(f"format is one of {', '.join(known)}; got {shown(self.format)}")
        if self.rate is not None and self.time:
            raise ValueError("give time, a column, or rate, not both")
        if self.align is not None and {"offset", "pace"} & self.model_fields_set:
            raise ValueError("give align: auto, or offset and pace, not both")
        return self


class Channel(_Sourced):
    """Where a winch's commands or its measured positions, or a cable's tension or length, are.

    Attributes:
      source: `from`, the column, with "-" in front for the other sign; several winches may have one.
      hold: the winch never moved: no column.
      unit: as under units.
      per: ticks per turn of the drum, for the unit `ticks`: `4096 / turn`.
      drum: radius of the drum [m], or with a unit: `12.7 mm`.
      add: added afterwards, as the rest length where the column is 0 [m].
      held: written only when it changed: the last value holds, however long.
      noise: standard deviation of what is measured [m or N], also with a unit: `0.2 mm`, `0.5 N`.
    """

    source: Name | None = Field(default=None, alias="from")
    hold: bool = False
    unit: str | None = None
    per: PerTurn | None = None
    drum: Radius | None = None
    add: Length = 0.0
    held: bool = False
    noise: Noise | None = None

    @model_validator(mode="before")
    @classmethod
    def _of_text(cls, value: Any) -> Any:
        if value is None:
            raise ValueError(f"to fill in: a column, or {HOLD} if it never moved")
        if not isinstance(value, str):
            return value
        return {"hold": True} if value == HOLD else {"from": value}

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        if self.hold == (self.source is not None):
            raise ValueError("give from, a column, or hold")
        if self.hold and (others := sorted(self.model_fields_set - {"hold", "source"})):
            raise ValueError(f"{', '.join(others)}: no effect on a winch on hold")
        return self


class TensionChannel(Channel):
    """A cable's tension, whose noise [N] is no length."""

    noise: Annotated[float, NOISE, BeforeValidator(partial(_noise, FORCES))] | None = None


class LengthChannel(Channel):
    """A cable's length, whose noise [m] is no force."""

    noise: Annotated[float, NOISE, BeforeValidator(partial(_noise, LENGTHS))] | None = None


class PoseSource(_Sourced):
    """Where the pose of a body is, which gives the positions of its tracked points.

    Attributes:
      source: `from`, the name of the body in the file; or position and rotation give columns.
      position: three columns, or a name with three.
      rotation: columns of a quaternion or of three angles, or a name with as many.
      order: of the rotation: xyzw or wxyz of a quaternion; of angles three letters, capitals for turns about
        the body's own axes (XYZ), small ones for fixed axes (xyz).
      unit: of the angles.
      at: the MJCF's body frame in the file's body frame [m].
      turned: rotation of the MJCF's body frame in the file's body frame, as a quaternion w, x, y, z.
    """

    source: Name | None = Field(default=None, alias="from")
    position: Name | tuple[Name, Name, Name] | None = None
    rotation: Name | tuple[Name, ...] | None = None
    order: Annotated[str, Field(pattern=r"^(xyzw|wxyz|[xyz]{3}|[XYZ]{3})$")] | None = None
    unit: Literal["deg", "rad"] | None = None
    at: Triple = (0.0, 0.0, 0.0)
    turned: tuple[Part, Part, Part, Part] = (1.0, 0.0, 0.0, 0.0)

    @model_validator(mode="before")
    @classmethod
    def _of_text(cls, value: Any) -> Any:
        return {"from": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        if (self.source is None) != (self.position is not None and self.rotation is not None):
            raise ValueError("give from, the name of the body, or position and rotation")
        if self.order and any(a == b for a, b in pairwise(self.order)):
            raise ValueError(f"order turns twice about one axis in a row; got {self.order}")
        if not math.isclose(math.hypot(*self.turned), 1.0, abs_tol=1e-3):
            raise ValueError(
                f"turned is a quaternion w, x, y, z of length 1; got {shown(self.turned)}"
            )
        return self


MarkerSource = Name | tuple[Name, ...] | None
