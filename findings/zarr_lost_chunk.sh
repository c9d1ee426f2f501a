#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" zarr==3.1.6 numpy==2.4.6
echo "guess:     reading an array one of whose chunk files is lost is an error"
echo "behaviour: the lost chunk reads as zeros; a chunk of zeros has no file, so both look the same"
python - <<'PYTHON'
from pathlib import Path

import numpy as np
import zarr

written = np.arange(1.0, 13.0)
zarr.create_array("a", shape=12, chunks=4, dtype="f8")[:] = written
Path("a/c/1").unlink()
lost = zarr.open_array("a", mode="r")[:]

zeros = np.where((written > 4) & (written < 9), 0.0, written)
zarr.create_array("b", shape=12, chunks=4, dtype="f8")[:] = zeros
files = sorted(path.name for path in Path("b/c").iterdir())

print(f"seen:      {lost.tolist()}; files of an array with zeros in the middle: {files}")
assert (lost == zeros).all() and files == ["0", "2"], "this has changed"
PYTHON
