#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" scipy==1.17.1 numpy==2.4.6
echo "guess:     make_smoothing_spline chooses its smoothing from the data: times in seconds and in milliseconds give the same curve"
echo "behaviour: the best smoothing is sought between 0 and the number of samples, in the cube of the times' unit: of 0.5 s at 1 kHz, in seconds, a straight line is left, in microseconds all the noise"
python - <<'PYTHON'
import numpy as np
from scipy.interpolate import make_smoothing_spline

seconds = 0.001 * np.arange(500)
swing = np.sin(2 * np.pi * 10 * seconds)
noisy = swing + np.random.default_rng(0).normal(0, 0.05, 500)
found = {}
for unit, scale in (("s", 1.0), ("ms", 1e3), ("us", 1e6)):
    curve = make_smoothing_spline(seconds * scale, noisy)(seconds * scale)
    found[unit] = round(float(np.std(curve - swing)), 3)
print(f"seen:      error of a smoothed swing of 1 with a noise of 0.05, by the unit of its times: {found}")
assert found["s"] > 0.6 and found["ms"] < 0.02 and found["us"] > 0.04, "this has changed"
PYTHON
