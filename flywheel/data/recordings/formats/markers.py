"""Columns of markers and bodies under their names; several of one name are one marker, or told apart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from flywheel.data.recordings.formats.stream import ANGLES, POSITION, QUATERNION
from flywheel.records import Floats

Part = tuple[str, Floats]  # a name, and (N, 3) positions


def named(parts: Sequence[Part]) -> tuple[dict[str, Floats], list[str]]:
    """Columns of markers, and notes about those of the same name.

    A tracker that lost a marker continues it in other columns of the same name: they are one marker if no
    two of them are seen at once. Otherwise the second is called `name (2)`.
    """
    found: dict[str, Floats] = {}
    count, joined = Counter[str](), Counter[str]()
    for name, points in parts:
        seen = np.isfinite(points).all(axis=1, keepdims=True)
        points = np.where(seen, points, np.nan)
        if name in found and not (seen & np.isfinite(found[name])).any():
            found[name] = np.where(seen, points, found[name])
            joined[name] += 1
            continue
        count[name] += 1
        found[name if count[name] == 1 else f"{name} ({count[name]})"] = points
    notes = [
        f"{n + 1} parts of {name!r} that are never seen at once are one marker"
        for name, n in joined.items()
    ]
    notes += [
        f"{n} different columns are called {name!r}: the others are '{name} (2)', ..."
        for name, n in count.items()
        if n > 1
    ]
    columns = {
        f"{name}{axis}": points[:, i]
        for name, points in found.items()
        for i, axis in enumerate(POSITION)
    }
    return columns, notes


def rotation(name: str, values: Floats) -> dict[str, Floats]:
    """Columns of a body's rotation (N, 4) as x, y, z, w, or (N, 3) as angles."""
    axes = QUATERNION if values.shape[1] == 4 else ANGLES
    return {f"{name}{axis}": values[:, i] for i, axis in enumerate(axes)}
