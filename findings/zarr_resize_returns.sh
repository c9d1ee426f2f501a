#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" zarr==3.1.6 numpy==2.4.6
echo "guess:     elements that an array gains by resize are its fill value"
echo "behaviour: where an earlier resize had cut a chunk in two, they are what had been cut off"
python - <<'PYTHON'
import numpy as np
import zarr

array = zarr.create_array("a", shape=12, chunks=4, dtype="f8", fill_value=np.nan)
array[:] = np.arange(1.0, 13.0)
array.resize(6)
short = array[:]
array.resize(12)
print(f"seen:      {short.tolist()} became {array[:].tolist()}")
assert np.array_equal(array[:], [1, 2, 3, 4, 5, 6, 7, 8, *[np.nan] * 4], equal_nan=True), "this has changed"
PYTHON
