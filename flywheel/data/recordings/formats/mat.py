"""MATLAB's files: version 5 to 7 by SciPy, 7.3 by h5py."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, whosmat

from flywheel.data.recordings.formats.arrays import check_size, streams
from flywheel.data.recordings.formats.stream import Contents
from flywheel.errors import DataError

DEEPEST = 10  # structures within structures


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Fields of structures are named `structure.field`; texts and cells are left out."""
    try:
        sizes = [int(np.prod(shape, dtype=np.float64)) for _, shape, _ in whosmat(path)]
        check_size(sum(sizes), "the file")
        # As the numbers' own type, not as the one in which MATLAB packed them.
        content = loadmat(path, mat_dtype=True, struct_as_record=True)
    except Exception as error:  # SciPy raises whatever a damaged file leads to
        if isinstance(error, DataError):
            raise
        raise DataError(f"it is damaged: {str(error).splitlines()[:1]}.") from None
    found, left = {}, []
    for name, value in content.items():
        if not name.startswith("__"):
            for inner, each in _leaves(name, value, 0):
                if each is None:
                    left.append(inner)
                else:
                    found[inner] = each
    return streams(found, tuple(f"{name!r} is left out: it has no numbers" for name in left))


def _leaves(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Arrays in a value, with their names; None for what has no numbers."""
    if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1 and depth < DEEPEST:
        for each in value.dtype.names:
            yield from _leaves(f"{name}.{each}", value[each].flat[0], depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        yield name, value
    else:
        yield name, None
