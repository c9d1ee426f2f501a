#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" zarr==3.1.6 numpy==2.4.6
echo "guess:     rows that were appended to an array after consolidate_metadata are there for whoever opens its group"
echo "behaviour: they are not seen; who appends to the array through the group cuts them off"
python -W ignore - <<'PYTHON' # version 3 has no consolidated metadata yet, zarr says
import numpy as np
import zarr

zarr.create_group("log").create_array("x", shape=4, chunks=2, dtype="f8")[:] = 1.0
zarr.consolidate_metadata("log")
zarr.open_array("log/x", mode="r+").append(np.full(4, 2.0))
through_group = zarr.open_group("log", mode="r")["x"].shape
before = zarr.open_array("log/x", mode="r")[:].tolist()
zarr.open_group("log", mode="a")["x"].append(np.full(2, 3.0))
after = zarr.open_array("log/x", mode="r")[:].tolist()
print(f"seen:      4 rows of 1, 4 of 2 appended: {before}, through the group {through_group[0]} rows; 2 rows of 3 appended through it: {after}")
assert through_group == (4,) and len(before) == 8 and after == [1, 1, 1, 1, 3, 3], "this has changed"
PYTHON
