#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" scikit-learn==1.9.1 scipy==1.17.1 numpy==2.4.6
echo "guess:     alpha is the variance of the measurements' noise, in their unit, with normalize_y, too"
echo "behaviour: it is that of the normalised ones: with noise of 2 cm, deviations in metres are a tenth of what they should be, and in millimetres the data are ignored"
python - <<'PYTHON'
import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF

NOISE = 0.02
times = np.linspace(0, 1, 60)[:, None]
true = 0.1 * np.sin(6 * times[:, 0])
measured = true + np.random.default_rng(0).normal(0, NOISE, len(true))


def errors(metre, scale):
    """Mean error [m] and mean given deviation [m], of data in units of which `metre` are one metre."""
    process = GaussianProcessRegressor(RBF(0.3), alpha=(NOISE * metre / scale) ** 2, optimizer=None, normalize_y=True)
    mean, deviation = process.fit(times, measured * metre).predict(times, return_std=True)
    return [round(float(number), 4) for number in (abs(mean / metre - true).mean(), (deviation / metre).mean())]


metres, millimetres = errors(1.0, 1.0), errors(1000.0, 1.0)
right = errors(1.0, measured.std()), errors(1000.0, 1000 * measured.std())
print(f"seen:      mean error and deviation [m]: in metres {metres}, in millimetres {millimetres}; with alpha divided by the data's variance {right}")
assert right[0] == right[1] and metres != millimetres and millimetres[0] > 5 * right[0][0], "this has changed"
assert metres[1] < right[0][1] / 4, "this has changed"
PYTHON
