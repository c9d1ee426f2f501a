"""Arrays with names, as MATLAB, NumPy and HDF5 save them, as columns that share their times."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Any

import numpy as np

from flywheel.data.recordings.formats.stream import Contents, Stream, named_time
from flywheel.errors import DataError
from flywheel.records import Floats

WIDEST = 1_000  # numbers in a row of one array; images have more
MOST_NUMBERS = 100_000_000  # in a file: 800 MB
FEWEST = 2  # rows


def streams(arrays: Mapping[str, Any], notes: tuple[str, ...] = ()) -> Contents:
    """Arrays as columns `name`, `name[0]` or `name[0][1]`; those with as many rows are one stream.

    The rows are along the axis that is as long as an array with one axis, else along the longest. An array
    with one row less than the times is that of their first rows.

    Raises:
      DataError: no array holds numbers of at least two rows.
    """
    kept = {name: each for name, each in arrays.items() if _is_series(each)}
    lines = {n: max(each.shape) for n, each in kept.items() if each.size == max(each.shape)}
    vectors, timed = {*lines.values()}, {size for name, size in lines.items() if named_time(name)}
    groups: dict[int, dict[str, Floats]] = defaultdict(dict)
    for name, each in kept.items():
        rows = _rows_first(each, vectors)
        if rows.size // len(rows) > WIDEST:
            notes += (
                f"{name!r} is left out: it has {rows.size // len(rows):,} numbers in each row",
            )
            continue
        columns = columns_of(name, rows)
        if len(rows) + 1 in timed and len(rows) not in timed:
            notes += (f"{name!r} has no last row, as commands between measurements",)
            columns = {each: np.append(values, np.nan) for each, values in columns.items()}
        groups[len(next(iter(columns.values())))] |= columns
    if not groups:
        raise DataError("it has no arrays of numbers with at least two rows.")
    return Contents(tuple(Stream(each) for each in groups.values()), notes)


def columns_of(name: str, rows: Any) -> dict[str, Floats]:
    """Columns (N,) of an array (N, ...)."""
    values = np.asarray(rows, np.float64)
    flat = values.reshape(len(values), -1)
    if values.ndim == 1 or flat.shape[1] == 1:
        return {name: flat[:, 0]}
    places = np.ndindex(*values.shape[1:])
    return {f"{name}{''.join(f'[{i}]' for i in at)}": flat[:, k] for k, at in enumerate(places)}


def check_size(count: int, name: str) -> None:
    """Raises DataError if a file, or an array of it, has too many numbers."""
    if count > MOST_NUMBERS:
        raise DataError(f"{name} has {count:,} numbers; at most {MOST_NUMBERS:,} are read.")


def _is_series(each: Any) -> bool:
    there = isinstance(each, np.ndarray) and each.dtype.kind in "biuf"
    return bool(there and each.size and max(each.shape, default=0) >= FEWEST)


def _rows_first(each: Any, vectors: set[int]) -> Any:
    lengths = np.array(each.shape)
    matching = [axis for axis, length in enumerate(lengths) if length in vectors and length > 1]
    return np.moveaxis(each, matching[0] if len(matching) == 1 else int(lengths.argmax()), 0)
