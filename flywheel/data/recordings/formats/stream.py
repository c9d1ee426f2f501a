"""The one shape in which every format of a log is read: named columns that share their times."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from flywheel.records import Floats

POSITION = (".x", ".y", ".z")  # columns of a marker, or of a body's position
QUATERNION = (".qx", ".qy", ".qz", ".qw")  # columns of a body's rotation
ANGLES = (".rx", ".ry", ".rz")  # the same in three angles, in the order of the file
# Columns of times, even where the map does not say so.
TIME_NAMES = (
    "time",
    "t",
    "timestamp",
    "timestamps",
    "stamp",
)


@dataclass(frozen=True)
class Stream:
    """Columns of a file that were written together.

    Attributes:
      columns: name -> (N,) numbers as in the file; NaN where missing. A marker `m` is in `m.x`, `m.y` and
        `m.z`; the rotation of a body in `.qx` to `.qw`, or in `.rx` to `.rz` as angles.
      time: (N,) [s]; None if no column is known to be the time.
      texts: name -> (N,) texts of the columns that are not numbers.
      stamps: names of columns that are dates: seconds since 1970.
      length: unit of the positions that the file gives; None without one.
      asks_unit: positions have a unit that the file should give, and does not.
      angle: unit of the rotations' angles, "deg" or "rad".
      rows: the same with a row for each marker and time, if the file has it so.
    """

    columns: Mapping[str, Floats]
    time: Floats | None = None
    texts: Mapping[str, list[str]] = field(default_factory=dict)
    stamps: frozenset[str] = frozenset()
    length: str | None = None
    asks_unit: bool = False
    angle: str = "rad"
    rows: Stream | None = None


@dataclass(frozen=True)
class Contents:
    """All that a reader found in a file.

    Attributes:
      streams: with at least one column each.
      notes: sentences about what was left out, or is not as it seems.
    """

    streams: tuple[Stream, ...]
    notes: tuple[str, ...] = ()


class Reader(Protocol):
    """Reads all files of one format; the module of the format is one."""

    def read(self, path: Path, names: tuple[str, ...]) -> Contents:
        """The numbers of a file.

        Args:
          path: of a file that looks like one of this format.
          names: of the columns of a table without a header.

        Raises:
          DataError: it is damaged, or holds nothing of use.
        """
        ...


def named_time(name: str) -> bool:
    """True for a column that may be the time by its name."""
    return name.lower() in TIME_NAMES or re.search(r"time|stamp|zeit", name.lower()) is not None


def metres(word: str) -> str | None:
    """The unit of lengths that a file calls by this word: "m", "cm", "mm", "in" or "ft"; None if unknown."""
    return _LENGTHS.get(word.strip().lower().rstrip("."))


_LENGTHS = {
    word: unit
    for unit, words in {
        "m": ("m", "meter", "meters", "metre", "metres"),
        "cm": ("cm", "centimeter", "centimeters", "centimetres"),
        "mm": ("mm", "millimeter", "millimeters", "millimetres"),
        "in": ("in", "inch", "inches"),
        "ft": ("ft", "foot", "feet"),
    }.items()
    for word in words
}
