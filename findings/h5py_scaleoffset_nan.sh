#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" h5py==3.16.0 numpy==2.4.6
echo "guess:     scaleoffset=3 rounds to three decimals; NaN stays NaN, as without it and as infinity does"
echo "behaviour: a NaN after the first number comes back as the smallest number of its chunk"
python - <<'PYTHON'
import h5py
import numpy as np

heights = np.array([1.5, 1.2504, np.nan, 1.75, np.nan, 2.0])
with h5py.File("log.h5", "w") as file:
    for name, written in (("nan", heights), ("inf", np.where(np.isnan(heights), np.inf, heights))):
        file.create_dataset(name, data=written, chunks=(6,), scaleoffset=3)
with h5py.File("log.h5") as file:
    nan, inf = file["nan"][:], file["inf"][:]
print(f"seen:      {heights.tolist()} became {nan.tolist()}; with inf instead of nan {inf.tolist()}")
assert np.allclose(nan, [1.5, 1.25, 1.25, 1.75, 1.25, 2.0], atol=5e-4), "this has changed"
assert np.isinf(inf[[2, 4]]).all() and np.isfinite(nan).all(), "this has changed"
PYTHON
