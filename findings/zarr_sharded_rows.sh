#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" zarr==3.1.6 numpy==2.4.6
echo "guess:     rows that are written by their numbers, or a mask, are written whether the array has shards or not"
echo "behaviour: with shards, of an array of rows and columns they are refused, as a mismatch of shapes; they are read, and one after the other written"
python - <<'PYTHON'
import numpy as np
import zarr

rows, values = [1, 4], np.arange(12.0).reshape(2, 6) + 1
mask = np.isin(np.arange(12), rows)


def written(selection, **layout):
    """Whether two rows of six numbers are written, and read again."""
    array = zarr.create_array(store={}, shape=(12, 6), chunks=(2, 2), dtype="f8", **layout)
    try:
        array.oindex[selection] = values
    except (ValueError, IndexError) as error:
        assert not array[:].any()
        array[1], array[4] = values
        assert np.array_equal(array.oindex[selection], values)
        return f"{type(error).__name__}: {error}"
    return np.array_equal(array.oindex[selection], values)


plain, sharded, masked = written(rows), written(rows, shards=(6, 4)), written(mask, shards=(6, 4))
print(f"seen:      two rows of six numbers: without shards {plain}; with shards {sharded}; by a mask {masked}")
assert plain is True and "shape mismatch" in sharded and "shape mismatch" in masked, "this has changed"
PYTHON
