"""NumPy's archives and arrays, never their pickles."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.data.recordings.formats.arrays import check_size, streams
from flywheel.data.recordings.formats.stream import Contents
from flywheel.errors import DataError

NUMBERS = "biufmMV"  # letters of types, with those of times, and of arrays with named fields
PICKLED = (
    "an array of Python objects is a pickle, which runs code when it is read; save plain numbers."
)


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Arrays of objects are refused before any array is read; texts are left out."""
    try:
        if not zipfile.is_zipfile(path):
            with path.open("rb") as file:
                _kind(file, "its array")
                file.seek(0)
                return streams(_leaves("array", np.lib.format.read_array(file)))
        with zipfile.ZipFile(path) as archive:
            return _archive(archive)
    except (
        ValueError,
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        OSError,
        SyntaxError,
        RuntimeError,
    ) as error:
        raise DataError(f"it is damaged: {error}.") from None


def _archive(archive: zipfile.ZipFile) -> Contents:
    members = [each for each in archive.infolist() if each.filename.endswith(".npy")]
    kinds = {}
    for each in members:
        with archive.open(each) as file:
            kinds[each.filename] = _kind(file, each.filename)
    check_size(sum(each.file_size for each in members) // 8, "the archive")
    found = dict[str, Any]()
    for each in members:
        if kinds[each.filename] in NUMBERS:
            with archive.open(each) as file:
                array = np.lib.format.read_array(file)
                found |= _leaves(each.filename.removesuffix(".npy"), array)
    left = [name for name, kind in kinds.items() if kind not in NUMBERS]
    return streams(found, tuple(f"{name!r} is left out: it has no numbers" for name in left))


def _leaves(name: str, array: Any) -> dict[str, Any]:
    """Arrays of numbers in an array, whose fields are `name.field`; dates and durations are seconds."""
    if array.dtype.names:
        fields = (_leaves(f"{name}.{each}", array[each]) for each in array.dtype.names)
        return {inner: each for found in fields for inner, each in found.items()}
    if array.dtype.kind in "mM":
        seconds = array.astype(f"{array.dtype.kind}8[ns]").astype(np.int64) / 1e9
        return {name: np.where(np.isnat(array), np.nan, seconds)}
    return {name: array}


def _kind(file: Any, name: str) -> str:
    """Letter of the type of an array in a file of which only the header is read.

    Raises:
      DataError: it holds Python objects, or too many numbers.
    """
    newer = np.lib.format.read_magic(file) != (1, 0)
    reader = np.lib.format.read_array_header_2_0 if newer else np.lib.format.read_array_header_1_0
    shape, _, kind = reader(file)
    if kind.hasobject:
        raise DataError(f"{name}: {PICKLED}")
    check_size(int(np.prod(shape, dtype=np.float64)), name)
    return str(kind.kind)
