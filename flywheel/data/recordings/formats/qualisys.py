"""TSV exports of Qualisys Track Manager: markers, or bodies with six degrees of freedom."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from flywheel.data.recordings.formats.markers import Part, named, rotation
from flywheel.data.recordings.formats.stream import Contents, Stream
from flywheel.data.recordings.formats.text import (
    after_line,
    cells,
    columns,
    content_of,
    distinct,
    head,
    is_number,
    numbers,
)
from flywheel.errors import DataError
from flywheel.records import Floats

HEADER_LINES = 60  # in which the header ends
BODY = 16  # columns of a body: x y z, roll pitch yaw, residual, nine of the rotation matrix
LOST = 1e-9  # an unseen marker is at the origin to the last digit


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Lengths are millimetres, as QTM always writes them."""
    content = content_of(path)
    rows = [cells(line, "\t") for line in head(content, HEADER_LINES)]
    about = {
        row[0].upper(): row[1:] for row in rows if row and row[0].isupper() and len(row[0]) > 1
    }
    first = next((i for i, row in enumerate(rows) if _is_data(row)), None)
    markers = [name for name in about.get("MARKER_NAMES", []) if name]
    bodies = [name for name in about.get("BODY_NAMES", []) if name]
    others = [name for name in about.get("DATA_TYPES", []) if name]
    width = len(markers) * 3 or len(bodies) * BODY or len(others)
    if first is None or not width:
        raise DataError("it lacks MARKER_NAMES, BODY_NAMES and DATA_TYPES, or has no rows.")
    before = 2 if len(rows[first]) >= width + 2 else 0  # the frame and its time
    table = columns(after_line(content, first), "\t", before + width, first + 1)
    rate = _number(about, "FREQUENCY")
    time = numbers(table[1], "Time") if before else np.arange(len(table[0])) / rate
    data = [numbers(each, f"column {i}") for i, each in enumerate(table[before:], before + 1)]
    if markers:
        found, notes = named(
            [_marker(name, data[3 * i : 3 * i + 3]) for i, name in enumerate(markers)]
        )
    elif bodies:
        found, notes = _bodies(bodies, data)
    else:
        found, notes = dict(zip(distinct(others), data, strict=True)), []
    return Contents((Stream(found, time, length="mm", angle="deg"),), tuple(notes))


def _is_data(row: list[str]) -> bool:
    return len(row) > 2 and any(row) and all(_is_value(cell) for cell in row if cell)


def _is_value(cell: str) -> bool:
    return is_number(cell) or cell.lower() in ("null", "-")


def _number(about: dict[str, list[str]], key: str) -> float:
    try:
        value = float(about[key][0])
    except (KeyError, IndexError, ValueError):
        raise DataError(f"its header lacks {key}, a number.") from None
    if not 0 < value < 1e6:
        raise DataError(f"its {key} is {value:g}.")
    return value


def _marker(name: str, axes: list[Floats]) -> Part:
    points = np.stack(axes, axis=1)
    return name, np.where((np.abs(points) < LOST).all(axis=1, keepdims=True), np.nan, points)


def _bodies(names: list[str], data: list[Floats]) -> tuple[dict[str, Floats], list[str]]:
    """Positions and rotations of bodies; the matrix says the rotation, whatever the angles' order is."""
    parts, turned = [], dict[str, Floats]()
    for i, name in enumerate(names):
        block = np.stack(data[BODY * i : BODY * (i + 1)], axis=1)
        matrix = block[:, 7:].reshape(-1, 3, 3).swapaxes(1, 2)  # written column by column
        seen = np.isfinite(block).all(axis=1) & (
            np.abs(np.linalg.det(np.nan_to_num(matrix)) - 1) < 0.01
        )
        quaternion = np.full((len(block), 4), np.nan)
        if seen.any():
            quaternion[seen] = Rotation.from_matrix(matrix[seen]).as_quat()
        parts.append((name, np.where(seen[:, None], block[:, :3], np.nan)))
        turned |= rotation(name, quaternion)
    found, notes = named(parts)
    return found | turned, notes
