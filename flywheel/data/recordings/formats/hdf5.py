"""HDF5 files, and MATLAB's of version 7.3, which are such."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flywheel.data.recordings.formats.arrays import check_size, streams
from flywheel.data.recordings.formats.stream import Contents
from flywheel.errors import ConfigError, DataError


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Data sets are named by their paths; links to other files are not followed."""
    try:
        import h5py  # an extra
    except ImportError:
        raise ConfigError("HDF5 needs h5py: install flywheel[formats].") from None
    found: dict[str, Any] = {}
    left: list[str] = []
    with path.open("rb") as file:
        matlab = file.read(6) == b"MATLAB"

    def visit(name: str, each: Any) -> None:
        if not isinstance(each, h5py.Dataset) or name.startswith("#"):
            return
        plain = each.dtype.names or each.dtype.kind in "biuf"
        if not plain or each.is_virtual or each.external or "MATLAB_empty" in each.attrs:
            left.append(name)
            return
        check_size(each.size or 0, name)
        check_size(sum(a.size for a in found.values()), "the file")
        name = name.replace("/", ".") if matlab else name
        if each.dtype.names:
            values = each[()]
            numbers = [f for f in each.dtype.names if values.dtype[f].kind in "biuf"]
            found.update({f"{name}.{f}": np.asarray(values[f]) for f in numbers})
        else:
            found[name] = np.asarray(each[()]).T if matlab else np.asarray(each[()])

    try:
        with h5py.File(path, "r") as opened:
            opened.visititems(visit)
    except DataError:
        raise
    except Exception as error:  # h5py raises whatever a damaged file leads to
        raise DataError(f"it is damaged: {str(error).splitlines()[:1]}.") from None
    return streams(
        found, tuple(f"{name!r} is left out: it has no numbers of its own" for name in left)
    )
