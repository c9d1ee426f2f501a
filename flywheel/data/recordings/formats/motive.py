"""CSV exports of OptiTrack Motive, versions 1.x to 3: bodies with their rotations, and markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flywheel.data.recordings.formats.markers import named, rotation
from flywheel.data.recordings.formats.stream import Contents, Stream, metres
from flywheel.data.recordings.formats.text import (
    after_line,
    cells,
    columns,
    content_of,
    head,
    numbers,
)
from flywheel.errors import DataError
from flywheel.records import Floats

HEADER_LINES = 30  # in which the header ends
BODIES = ("rigid body", "bone")
SOLVED = ("rigid body marker", "bone marker")  # where the body puts its marker, seen or not


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. A marker computed from its body is `name (solved)` if it was measured, too."""
    content = content_of(path)
    header = _header(head(content, HEADER_LINES))
    values = columns(after_line(content, header.lines), ",", len(header.axes), header.lines + 1)
    parts, turned = [], dict[str, Floats]()
    measured = {
        name
        for _, (kind, name, channel) in header.groups
        if channel == "position" and kind not in SOLVED
    }
    for places, (kind, name, channel) in header.groups:
        block = np.stack([numbers(values[i], name) for i in places], axis=1)
        if channel == "rotation":
            turned |= rotation(name, block)
        else:
            computed = kind in SOLVED and name in measured
            parts.append((f"{name} (solved)" if computed else name, block))
    if not parts:
        raise DataError("it has no positions of markers or bodies.")
    found, notes = named(parts)
    unit = metres(header.about.get("length units", ""))
    times = numbers(values[header.axes.index(header.time)], header.time)
    stream = Stream(found | turned, times, length=unit, asks_unit=unit is None, angle="deg")
    return Contents((stream,), tuple(notes))


@dataclass(frozen=True)
class _Header:
    """Attributes: about: pairs of the first row; lines: in all; axes: its last row; time: the time's column;
    groups: (columns, (type, name, channel)) of each position and rotation.
    """

    about: dict[str, str]
    lines: int
    axes: list[str]
    time: str
    groups: list[tuple[range, tuple[str, str, str]]]


def _header(lines: Sequence[str]) -> _Header:
    rows = [cells(line, ",") for line in lines]
    last = next((i for i, row in enumerate(rows) if row and row[0].lower() == "frame"), None)
    if last is None:
        raise DataError("it begins as an export of Motive, but no row begins with 'Frame'.")
    first = [cell.lower() for cell in rows[0][::2]]
    about = dict(zip(first, rows[0][1::2], strict=False))
    axes = rows[last]
    time = next(
        (name for name in axes if name.lower() == "time" or name.lower().startswith("time (sec")),
        None,
    )
    above = [row for row in rows[1:last] if any(row)]
    if time is None or len(above) < 3:
        raise DataError(
            "its header lacks the rows of types, names and channels, or the column of the time."
        )
    labels = [next((c.lower() for c in row[:2] if c), "") for row in above]
    named_row = above[labels.index("name")] if "name" in labels else above[1]
    kinds, channels = above[0], above[-1]

    def at(row: Sequence[str], column: int) -> str:
        return row[column] if column < len(row) else ""

    groups, body = [], ""
    for i in range(axes.index(time) + 1, len(axes)):
        kind, name, channel = at(kinds, i).lower(), at(named_row, i), at(channels, i).lower()
        if kind in BODIES:
            body = name
        elif kind in SOLVED and ":" not in name:
            name = f"{body}:{name}"
        if axes[i].upper() == "X" and channel in ("position", "rotation"):
            count = 4 if channel == "rotation" and at(axes, i + 3).upper() == "W" else 3
            groups.append((range(i, i + count), (kind, name, channel)))
    return _Header(about, last + 1, axes, time, groups)
