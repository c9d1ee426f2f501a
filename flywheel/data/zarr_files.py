"""The arrays of a segment as a Zarr v3 group on a local disk; the only file that imports zarr.

Every array is one shard (one file) of compressed chunks, each with a crc32c of its own, so that a
flipped bit raises instead of decoding to other numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import BloscCodec, Crc32cCodec

from flywheel.errors import DataError

CHUNK_ROWS = 512


def write_group(
    folder: Path, arrays: Mapping[str, NDArray[Any]], attributes: dict[str, Any]
) -> None:
    """Write arrays, each (rows, ...), and JSON attributes as a new group.

    Raises:
      OSError: the disk is full, or the folder exists.
    """
    group = zarr.create_group(folder, attributes=attributes, overwrite=False)
    for name, values in sorted(arrays.items()):
        rows = max(1, -(-len(values) // CHUNK_ROWS)) * CHUNK_ROWS
        array = group.create_array(
            name,
            shape=values.shape,
            dtype=values.dtype,
            chunks=(CHUNK_ROWS, *(max(1, n) for n in values.shape[1:])),
            shards=(rows, *(max(1, n) for n in values.shape[1:])),
            compressors=[
                BloscCodec(cname="zstd", clevel=3, shuffle="bitshuffle"),
                Crc32cCodec(),
            ],
            fill_value=0,
        )
        if values.size:
            array[...] = values


def read_group(
    folder: Path, names: tuple[str, ...] | None = None
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read arrays (all, or those named) and attributes of a group.

    Raises:
      DataError: an array is missing or does not decode.
    """
    try:
        group = zarr.open_group(folder, mode="r")
        found = sorted(group.array_keys()) if names is None else names
        arrays = {name: np.asarray(cast("zarr.Array", group[name])[...]) for name in found}
        return arrays, dict(group.attrs)
    except (ValueError, KeyError, OSError, RuntimeError) as error:
        raise DataError(f"{folder.parent.name} does not decode: {error}") from error
