"""TRC files, the marker trajectories of OpenSim and others."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flywheel.data.recordings.formats.markers import named
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

HEADER_LINES = 5
ROUNDED = 0.51e-3  # [s] by which written times may be rounded


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Unseen markers are empty cells; times rounded to 1 ms are made exact by the data rate."""
    content = content_of(path)
    between = "\t" if b"\t" in content[:20] else ","
    rows = [cells(line, between) for line in head(content, HEADER_LINES)]
    if len(rows) < HEADER_LINES or rows[3][:1] != ["Frame#"]:
        raise DataError("its header is not the five rows of a TRC file.")
    about = dict(zip(rows[1], rows[2], strict=False))
    markers = [name for name in rows[3][2:] if name]
    body = after_line(content, HEADER_LINES)
    table = columns(body, between, 2 + 3 * len(markers), HEADER_LINES + 1)
    data = [numbers(each, f"column {i}") for i, each in enumerate(table, 1)]
    parts = [
        (name, np.stack(data[2 + 3 * i : 5 + 3 * i], axis=1)) for i, name in enumerate(markers)
    ]
    found, notes = named(parts)
    unit = metres(about.get("Units", ""))
    time = _exact(data[1], data[0], about.get("DataRate", ""))
    return Contents((Stream(found, time, length=unit, asks_unit=unit is None),), tuple(notes))


def _exact(time: Floats, frames: Floats, rate: str) -> Floats:
    """The times (N,) [s] as multiples of the file's rate where they are those, rounded, by frames or rows."""
    try:
        step = 1.0 / float(rate)
    except (ValueError, ZeroDivisionError):
        return time
    for count in (frames - frames[0], np.arange(len(time))):
        ideal = time[0] + step * count
        if np.abs(time - ideal).max() <= 2 * ROUNDED:
            return ideal
    return time
