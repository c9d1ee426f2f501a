#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" filterpy==2.0.0 numpy==2.4.6 scipy==1.17.1
echo "guess:     after update(None), for a missing measurement, log_likelihood is 0: nothing was learnt"
echo "behaviour: it is that of a measurement that hits the last prediction exactly: what is missing argues for the noise of the last update"
python - <<'PYTHON'
import numpy as np
from filterpy.kalman import KalmanFilter

LOG = [0.0, 0.1, None, 0.3, None, None]


def likelihoods(noise):
    kalman = KalmanFilter(dim_x=2, dim_z=1)
    kalman.F, kalman.H = np.array([[1, 0.1], [0, 1]]), np.array([[1.0, 0.0]])
    kalman.R *= noise
    kalman.Q *= 1e-3
    found = []
    for value in LOG:
        kalman.predict()
        kalman.update(value)
        found.append(round(float(kalman.log_likelihood), 3))
    return found


def sums(found):
    seen = [each for each, value in zip(found, LOG) if value is not None]
    return round(sum(found), 2), round(sum(seen), 2)


low, high = likelihoods(0.003), likelihoods(0.01)
print(f"seen:      {low} for the measurements {LOG};")
print(f"           (sum, sum of measured) with variance .003 {sums(low)}, with .01 {sums(high)}")
missing = [each for each, value in zip(low, LOG) if value is None]
assert min(missing) > 0.5 and missing[1] == missing[2], "this has changed"
PYTHON
