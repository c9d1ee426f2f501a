#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" zarr==3.1.6 numcodecs==0.16.6 numpy==2.4.6
echo "guess:     the filter FixedScaleOffset, which keeps metres as whole millimetres of 16 bits, refuses 40 m, or clips it to 32.767 m"
echo "behaviour: 40 m is read as -25.536 m and 32.768 m as -32.768 m, without a warning; a marker that was not seen (NaN) is at the origin"
python - <<'PYTHON'
import warnings

import numpy as np
import zarr
from numcodecs.zarr3 import FixedScaleOffset

warnings.filterwarnings("ignore", message="Numcodecs codecs are not in the Zarr version 3 specification")


def kept(places):
    """The places [m] as they are read, and the warnings of writing them."""
    array = zarr.create_array(
        zarr.storage.MemoryStore(), shape=len(places), chunks=len(places), dtype="f8", fill_value=np.nan,
        filters=[FixedScaleOffset(offset=0, scale=1000, dtype="f8", astype="i2")],
    )  # fmt: skip
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        array[:] = places
    return array[:].tolist(), [str(each.message) for each in caught]


far, warned = kept(np.array([1.0, 32.767, 32.768, 40.0, -40.0]))
unseen, unseen_warned = kept(np.array([1.0, np.nan, 2.0]))
print(f"seen:      1, 32.767, 32.768, 40, -40 m: {far}, warnings {warned}; 1, NaN, 2 m: {unseen}, warnings {unseen_warned}")
assert far == [1.0, 32.767, -32.768, -25.536, 25.536] and not warned, "this has changed"
assert unseen == [1.0, 0.0, 2.0], "this has changed"
PYTHON
