#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" numdifftools==0.11.2 numpy==2.4.6 scipy==1.17.1
echo "guess:     Derivative chooses its own steps, and says by error_estimate how far off it may be"
echo "behaviour: they are of 0.5 and less for any x below 1: of a swing of 1 rad/ms, in seconds, it returns -5 in place of 955 1/s, and claims to be 0.005 off"
python - <<'PYTHON'
import numdifftools as nd
import numpy as np

seen = {}
for period in (1e-2, 1e-3, 1e-4):  # of one radian [s]
    found = nd.Derivative(lambda time, period=period: np.sin(time / period), full_output=True)(0.3 * period)
    values = np.cos(0.3) / period, found.estimate, found.error_estimate
    seen[period] = [float(f"{value:.2g}") for value in values]
width = 1e-3
point = np.array([0.5, 1.0]) * width


def well(place):
    """A well of 1 mm, by a place in metres."""
    return -np.exp(-np.sum((place / width) ** 2))


gradient, true = nd.Gradient(well)(point), -2 * well(point) * point / width**2
bounded = nd.Gradient(well, base_step=width / 100)(point)
print(f"seen:      derivative, what was found and error_estimate, by the time of a radian [s]: {seen};")
print(f"           gradient of a well of 1 mm: true {true.round(1)}, found {gradient.round(1)}, with base_step=1e-5 {bounded.round(1)}")
assert abs(seen[1e-2][0] - seen[1e-2][1]) < 1, "this has changed"
for period in (1e-3, 1e-4):
    true_one, found, claimed = seen[period]
    assert abs(true_one - found) > 0.9 * true_one > 1e4 * claimed, "this has changed"
assert np.abs(gradient).max() < 1e-6 and np.abs(bounded - true).max() < 1e-3, "this has changed"
PYTHON
