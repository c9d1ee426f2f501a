"""Arrays as the files of a Zarr v3 group and back; the only module that imports zarr.

Files are bytes by relative path, so that hashed and decoded bytes are the same, at any place. Every
array is one shard (one file) of compressed chunks, each with its own crc32c, so that a flipped bit
raises instead of decoding to other numbers.
"""

from __future__ import annotations

import atexit
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.core.buffer import Buffer, default_buffer_prototype
from zarr.core.sync import cleanup_resources
from zarr.storage import MemoryStore

from flywheel.errors import DataError

CHUNK_ROWS = 4096  # 41 s of an episode: all of it is read at once
MOST_TIMES_LARGER = 20_000  # times its file an array may be: zeros compress 4 300 times
Files = dict[str, bytes]
# It allows its thread a fifth of a second to end, and shows a traceback if a busy machine takes longer.
atexit.unregister(cleanup_resources)


def encode(arrays: Mapping[str, NDArray[Any]], attributes: dict[str, Any]) -> Files:
    """Files of a group of arrays, each (rows, ...), with JSON attributes.

    The same arrays give the same bytes (one thread compresses each chunk).
    """
    written: dict[str, Buffer] = {}
    group = zarr.create_group(_store(written), attributes=attributes)
    for name, values in sorted(arrays.items()):
        chunk = min(CHUNK_ROWS, max(1, len(values)))
        rows = -(-max(1, len(values)) // chunk) * chunk
        rest = tuple(max(1, size) for size in values.shape[1:])
        array = group.create_array(
            name,
            shape=values.shape,
            dtype=values.dtype,
            chunks=(chunk, *rest),
            shards=(rows, *rest),
            compressors=[BloscCodec(cname="zstd", clevel=3, shuffle="bitshuffle"), Crc32cCodec()],
            chunk_key_encoding={"name": "default", "separator": "."},  # no folders to flush
            fill_value=0,
            # A chunk of zeros is written too, so that a missing file is always damage.
            config={"write_empty_chunks": True},
        )
        if values.size:
            array[...] = values
    return {name: buffer.to_bytes() for name, buffer in sorted(written.items())}


def decode(files: Mapping[str, bytes]) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Arrays and attributes of a group.

    zarr fills missing chunks with zeros: compare the files with their list first.

    Raises:
      DataError: they do not decode.
    """
    prototype = default_buffer_prototype().buffer
    try:
        group = zarr.open_group(
            _store({name: prototype.from_bytes(content) for name, content in files.items()}),
            mode="r",
        )
        arrays = {name: cast("zarr.Array", group[name]) for name in group.array_keys()}
        for name, array in arrays.items():
            _check_size(name, array, files)
        return {name: np.asarray(array[...]) for name, array in arrays.items()}, dict(group.attrs)
    except (ValueError, KeyError, TypeError, OSError, RuntimeError) as error:
        raise DataError(f"These files are not a Zarr group that decodes: {error}") from error


def _check_size(name: str, array: zarr.Array, files: Mapping[str, bytes]) -> None:
    """Reject an array that claims to be far larger than its stored bytes."""
    stored = sum(len(content) for path, content in files.items() if path.startswith(f"{name}/"))
    if array.nbytes > MOST_TIMES_LARGER * stored:
        raise ValueError(f"{name} claims a shape of {array.shape}, but {stored} bytes are stored")


def _store(files: dict[str, Buffer]) -> Store:
    return MemoryStore(files)
