"""Tables with one row per marker and time, made tables with one row per time."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.formats.arrays import WIDEST, check_size
from flywheel.data.recordings.formats.stream import POSITION, Stream, named_time
from flywheel.errors import DataError
from flywheel.records import Floats

Indices = NDArray[np.int64]

MARKER = re.compile(r".*(marker|label|point|body|track|object).*|(.*[_. ])?(name|id)", re.I)
AXIS = re.compile(
    r"(?:(?:pos|position|p)[_. ]?)?([xyz])(?:[ _]*[\[(]?(mm|cm|m|in|ft)[\])]?)?", re.I
)


def by_marker(stream: Stream) -> Stream:
    """A table with the markers as columns, if in the given one a column names them row by row; else that one.

    The given one stays in `rows`. Columns that have one value at each time are kept.

    Raises:
      DataError: a marker has two rows at one time.
    """
    times = [name for name in stream.columns if named_time(name)]
    times += [name for name in stream.columns if name.lower().startswith("frame")]
    axes = {m[1].lower(): (n, m[2]) for n in stream.columns if (m := AXIS.fullmatch(n))}
    markers = [n for n in (*stream.texts, *stream.columns) if MARKER.fullmatch(n)]
    if not times or not markers or len(axes) < len(POSITION):
        return stream
    when, at = np.unique(stream.columns[times[0]], return_inverse=True)
    names, which = np.unique(_names(stream, markers[0]), return_inverse=True)
    if len(when) == len(at) or not 1 < len(names) <= WIDEST:
        return stream
    check_size(3 * len(when) * len(names), "a table of its markers")
    _check_once(at, which, when, names)
    columns, places = dict[str, Floats](), {name for name, _ in axes.values()}
    for name, values in stream.columns.items():
        one = np.full(len(when), np.nan)
        one[at] = values
        if name not in places and np.array_equal(one[at], values, equal_nan=True):
            columns[name] = one
    for axis in sorted(axes):
        found = np.full((len(when), len(names)), np.nan)
        found[at, which] = stream.columns[axes[axis][0]]
        columns |= {f"{name}.{axis}": found[:, i] for i, name in enumerate(names) if name}
    units = {unit.lower() for _, unit in axes.values() if unit}
    length = units.pop() if len(units) == 1 else stream.length
    return Stream(columns, stamps=stream.stamps & set(columns), length=length, rows=stream)


def _names(stream: Stream, column: str) -> list[str]:
    """Name of each row's marker, "" for none."""
    if column in stream.texts:
        return [text.strip() for text in stream.texts[column]]
    return ["" if np.isnan(each) else f"{each:.15g}" for each in stream.columns[column]]


def _check_once(at: Indices, which: Indices, when: Floats, names: NDArray[np.str_]) -> None:
    """Raises DataError if a named marker `which` (N,) has two rows at a time `at` (N,)."""
    pairs, count = np.unique(
        np.stack([which, at])[:, names[which] != ""], axis=1, return_counts=True
    )
    twice = np.flatnonzero(count > 1)
    if len(twice):
        name, time = names[pairs[0, twice[0]]], when[pairs[1, twice[0]]]
        raise DataError(
            f"the marker {str(name)!r} has {count[twice[0]]} rows at {time:.15g}, in {len(twice)} places "
            "in all: keep one row for each marker and time."
        )
