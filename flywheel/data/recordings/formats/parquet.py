"""Parquet files, also those of a LeRobot data set, whose names and rate are in its `meta/info.json`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from flywheel.data.recordings.formats.arrays import WIDEST, check_size, columns_of
from flywheel.data.recordings.formats.long import by_marker
from flywheel.data.recordings.formats.stream import Contents, Stream
from flywheel.errors import DataError
from flywheel.files import read_json
from flywheel.records import Floats

FRAME = "frame_index"
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. The times of a LeRobot data set are frames by its rate: its stamps are too coarse."""
    files = sorted((path / "data").rglob("*.parquet")) if path.is_dir() else [path]
    if not files:
        raise DataError("it has no data/**/*.parquet.")
    info = _info(path)
    parts = [_columns(file) for file in files]
    shared = set.intersection(*({*part, *texts} for part, texts, _ in parts))
    first, words, others = parts[0]
    found = {n: np.concatenate([part[n] for part, _, _ in parts]) for n in first if n in shared}
    texts = {n: [text for _, own, _ in parts for text in own[n]] for n in words if n in shared}
    if not found:
        raise DataError("it has no columns of numbers.")
    found = _renamed(found, info)
    left = [f"{name!r} is left out: it has no numbers" for name in others]
    stamps = frozenset(name for part, _, _ in parts for name in part if name in _dates(files[0]))
    rate = info.get("fps")
    time = None
    if isinstance(rate, int | float) and rate > 0 and FRAME in found:
        time = found[FRAME] / rate
    made = Stream(found, time, texts, stamps)
    return Contents((by_marker(made) if time is None else made,), tuple(left))


def _info(path: Path) -> dict[str, Any]:
    """The description of the LeRobot data set around a file; empty without one."""
    around = [path] if path.is_dir() else list(path.resolve().parents)[:3]
    for folder in around:
        if (folder / "meta" / "info.json").is_file():
            info = read_json(folder / "meta" / "info.json", "description", DataError)
            return info if isinstance(info, dict) else {}
    return {}


def _table(path: Path) -> Any:
    try:
        check_size(_numbers(path), path.name)
        return parquet.read_table(path, use_threads=False)
    except (pa.ArrowException, OSError, ValueError) as error:
        words = str(error).splitlines()[0]
        unfinished = "footer" in words or "magic" in words.lower()
        hint = " Was it not closed (LeRobot: finalize)?" if unfinished else ""
        raise DataError(f"{path.name} is damaged: {words}.{hint}") from None


def _numbers(path: Path) -> int:
    about = parquet.ParquetFile(path).metadata
    sizes = [
        about.row_group(i).column(j).num_values
        for i in range(about.num_row_groups)
        for j in range(about.num_columns)
    ]
    return sum(sizes)


def _columns(path: Path) -> tuple[dict[str, Floats], dict[str, list[str]], list[str]]:
    """Columns of numbers, columns of texts, and names of the others."""
    found, texts, left = dict[str, Floats](), dict[str, list[str]](), list[str]()
    table = _table(path)
    while any(map(pa.types.is_struct, table.schema.types)):
        table = table.flatten()  # names them `column.field`
    for name, values in zip(table.column_names, table.columns, strict=True):
        kind = values.type.value_type if pa.types.is_dictionary(values.type) else values.type
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            texts[name] = ["" if each is None else each for each in values.to_pylist()]
            continue
        made = _values(values.combine_chunks())
        if made is None or made[0:1].size > WIDEST:
            left.append(name)
        else:
            found |= columns_of(name, made)
    return found, texts, left


def _values(values: Any) -> Floats | None:
    """(N,) or (N, k) numbers of a column; None where it has none, or lists of different lengths.

    Dates, times of day and durations are seconds.
    """
    kind = values.type
    if pa.types.is_time(kind):
        whole = pa.int32() if pa.types.is_time32(kind) else pa.int64()
        return np.asarray(values.cast(whole), np.float64) / PER_SECOND[kind.unit]
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        return np.asarray(values.cast(pa.int64())) / PER_SECOND[kind.unit]
    if pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
        inner = _values(values.flatten()) if len(values) and not values.null_count else None
        if inner is None or len(inner) % len(values):
            return None
        if (
            not pa.types.is_fixed_size_list(kind)
            and len(np.unique(np.diff(np.asarray(values.offsets)))) > 1
        ):
            return None
        return inner.reshape(len(values), -1)
    try:
        # Not `safe`, which refuses whole numbers from 2^53 on: nanoseconds since 1970 are rounded.
        numbers = values.cast(pa.float64(), safe=False)
        return np.asarray(numbers.to_numpy(zero_copy_only=False), np.float64)
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        return None


def _dates(path: Path) -> set[str]:
    return {each.name for each in parquet.read_schema(path) if pa.types.is_timestamp(each.type)}


def _renamed(found: dict[str, Floats], info: dict[str, Any]) -> dict[str, Floats]:
    """The columns of a vector under the names that a LeRobot data set gives its numbers: `action.motor`."""
    features = info.get("features")
    names = dict[str, str]()
    for feature, about in features.items() if isinstance(features, dict) else ():
        given = _listed(about.get("names")) if isinstance(about, dict) else []
        for i, name in enumerate(given):
            old = f"{feature}[{i}]" if f"{feature}[{i}]" in found else feature
            if len(given) > 1 or old == feature:
                names[old] = f"{feature}.{name}"
    return {names.get(name, name): values for name, values in found.items()}


def _listed(names: Any) -> list[Any]:
    """Names of a vector's numbers, from a list, {"motors": [...]} or {name: index}."""
    if isinstance(names, dict):
        lists = [each for each in names.values() if isinstance(each, list)]
        return lists[0] if lists else sorted(names, key=lambda key: str(names[key]))
    return names if isinstance(names, list) else []
