#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" h5py==3.16.0 numpy==2.4.6
echo "guess:     floats that do not fit a data set of integers are refused; or they wrap, as in numpy"
echo "behaviour: they are clipped, without a warning: 40 m in millimetres of 16 bits are 32.767 m, a time in ns of 32 bits 2.1 s; NaN is 0"
python -W error - <<'PYTHON'
import h5py
import numpy as np

places = np.array([40000.0, -40000.0, 1.9, -1.9, np.nan])  # mm
stamps = np.array([1_000_000_000, 5_000_000_000])  # ns
with h5py.File("log.h5", "w") as file:
    file.create_dataset("places", shape=places.shape, dtype="int16")[:] = places
    file.create_dataset("stamps", shape=stamps.shape, dtype="int32")[:] = stamps
    found, times = file["places"][:].tolist(), file["stamps"][:].tolist()
print(f"seen:      {places.tolist()} as int16 {found}; {stamps.tolist()} as int32 {times}")
assert found == [32767, -32768, 1, -1, 0] and times == [10**9, 2**31 - 1], "this has changed"
PYTHON
