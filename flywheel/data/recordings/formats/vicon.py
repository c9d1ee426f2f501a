"""CSV exports of Vicon Nexus: blocks of trajectories, devices and model outputs, each with its rate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flywheel.data.recordings.formats.markers import Part, named
from flywheel.data.recordings.formats.stream import Contents, Stream, metres
from flywheel.data.recordings.formats.text import (
    cells,
    columns,
    content_of,
    distinct,
    head,
    numbers,
)
from flywheel.errors import DataError
from flywheel.records import Floats

BLOCKS = ("Trajectories", "Devices", "Model Outputs", "Joints", "Segments", "Events")
HEADER_LINES = 5  # title, rate, names, axes, units


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Names of subjects stay: `subject:marker`."""
    streams: list[Stream] = []
    notes: list[str] = []
    for title, block in _blocks(content_of(path)):
        if title == "Events":
            notes.append("its events are left out")
            continue
        found, more = _block(title, block)
        streams.append(found)
        notes += more
    if not streams:
        raise DataError("it has no block of trajectories, devices or model outputs with rows.")
    return Contents(tuple(streams), tuple(notes))


def _blocks(content: bytes) -> list[tuple[str, bytes]]:
    """Title and text of each block; a block ends where the next one begins."""
    begins = []
    for title in BLOCKS:
        for line in (
            f"{title}\r\n".encode(),
            f"{title}\n".encode(),
            f"{title},".encode(),
            f"{title}\t".encode(),
        ):
            at = 0 if content.startswith(line) else content.find(b"\n" + line) + 1
            if at or content.startswith(line):
                begins.append((at, title))
                break
    if not begins:
        raise DataError(f"it is damaged: no line begins one of its blocks ({', '.join(BLOCKS)}).")
    begins.sort()
    ends = [at for at, _ in begins[1:]] + [len(content)]
    return [(title, content[at:end]) for (at, title), end in zip(begins, ends, strict=True)]


def _block(title: str, content: bytes) -> tuple[Stream, list[str]]:
    lines = head(content, HEADER_LINES)
    delimiter = "\t" if content.count(b"\t", 0, 10_000) > content.count(b",", 0, 10_000) else ","
    rows = [cells(line, delimiter) for line in lines]
    if len(rows) < HEADER_LINES or not rows[3] or rows[3][0].lower() != "frame":
        raise DataError(
            f"the header of its block {title!r} is not five rows: title, rate, names, axes, units; was it "
            "saved anew by a spreadsheet?"
        )
    try:
        rate = float(rows[1][0])
    except (ValueError, IndexError):
        raise DataError(f"the second row of its block {title!r} is not a rate [Hz].") from None
    if not 0 < rate < 1e6:
        raise DataError(f"the rate of its block {title!r} is {rate:g} Hz.")
    axes = rows[3]
    body = content.split(b"\n", HEADER_LINES)[-1]
    values = [
        numbers(each, axes[i]) for i, each in enumerate(columns(body, delimiter, len(axes), 6))
    ]
    owners = _carried(rows[2], len(axes))
    parts, others = _sorted(owners, axes, values)
    found, notes = named(parts)
    units = {
        metres(unit) for unit, axis in zip(rows[4], axes, strict=False) if axis in ("X", "Y", "Z")
    }
    unit = units.pop() if len(units) == 1 else None
    time = _times(
        values[0], values[1] if len(axes) > 1 and axes[1].lower().startswith("sub") else None, rate
    )
    moves = bool(parts) and title == "Trajectories"
    return Stream(
        found | others, time, length=unit, asks_unit=moves and unit is None, angle="deg"
    ), notes


def _times(frames: Floats, parts: Floats | None, rate: float) -> Floats:
    """(N,) times [s] of the frames of a block, from the capture's first frame on."""
    per_frame = 1.0 if parts is None or not len(parts) else max(1.0, float(np.nanmax(parts)) + 1)
    whole = (frames - 1) * per_frame + (0.0 if parts is None else parts)
    return np.asarray(whole / rate)


def _carried(names: Sequence[str], width: int) -> list[str]:
    """The name above each column: the last one to its left."""
    found, last = [], ""
    for i in range(width):
        last = (names[i] if i < len(names) else "") or last
        found.append(last)
    return found


def _sorted(
    owners: Sequence[str], axes: Sequence[str], values: Sequence[Floats]
) -> tuple[list[Part], dict[str, Floats]]:
    """Markers, and the columns that are none."""
    parts: list[Part] = []
    others, i = {}, 2
    while i < len(axes):
        if tuple(axes[i : i + 3]) == ("X", "Y", "Z"):
            parts.append((owners[i], np.stack(values[i : i + 3], axis=1)))
            i += 3
            continue
        others[f"{owners[i]}.{axes[i]}" if owners[i] else axes[i]] = values[i]
        i += 1
    return parts, dict(zip(distinct(list(others)), others.values(), strict=True))
