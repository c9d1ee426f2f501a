#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" zarr==3.1.6 numcodecs==0.16.6 numpy==2.4.6
echo "guess:     the filter Delta gives back the floats that were written; a NaN is one NaN"
echo "behaviour: it stores differences and adds them up again: after a NaN the rest of its chunk is NaN, after 1e30 it is 1 m lower"
python -W ignore - <<'PYTHON'
import numpy as np
import zarr
from zarr.codecs.numcodecs import Delta

heights = np.array([1.5, 1.5, 1.25, 1.0, 1.25, 1.5, 1.75, 2.0])


def read_back(third):
    written = heights.copy()
    written[2] = third
    array = zarr.create_array("log.zarr", shape=(8,), chunks=(6,), dtype="float64", filters=[Delta(dtype="float64")], overwrite=True)
    array[:] = written
    return zarr.open_array("log.zarr", mode="r")[:].tolist()


whole, gap, spike = read_back(1.25), read_back(np.nan), read_back(1e30)
print(f"seen:      in chunks of six, {heights.tolist()} becomes {whole};")
print(f"           with a NaN {gap}; with 1e30 {spike}")
assert whole == heights.tolist() and np.isnan(gap[2:6]).all() and gap[6:] == whole[6:], "this has changed"
assert spike[3:6] == [0.0, 0.25, 0.5] and spike[6:] == whole[6:], "this has changed"
PYTHON
