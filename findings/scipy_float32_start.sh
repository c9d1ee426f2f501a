#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" scipy==1.17.1 numpy==2.4.6
echo "guess:     minimize and curve_fit fit a smooth model in single precision, as of a network, or say that they failed"
echo "behaviour: their differences are of 1e-8, which it does not feel: they give back the start, and call it a success"
python -W ignore - <<'PYTHON'
import numpy as np
from scipy.optimize import curve_fit, least_squares, minimize

times = np.linspace(0, 2, 100)
measured = 3 * np.exp(-1.7 * times)


def model(_, height, rate):
    return np.float32(height) * np.exp(-np.float32(rate) * times.astype(np.float32))


def cost(numbers):
    return np.mean((model(times, *numbers) - measured.astype(np.float32)) ** 2)


found = {}
for method in ("BFGS", "L-BFGS-B", "SLSQP"):
    result = minimize(cost, [2.0, 1.0], method=method)
    found[method] = (result.x.tolist(), result.success)
found["curve_fit"] = curve_fit(model, times, measured, p0=[2.0, 1.0])[0].tolist()
single = least_squares(lambda numbers: model(times, *numbers) - measured.astype(np.float32), [2.0, 1.0]).x
print(f"seen:      of 3 and 1.7 from 2 and 1: {found};")
print(f"           least_squares, which looks at the residual's type, {single.round(4).tolist()}")
assert all(result == ([2.0, 1.0], True) for name, result in found.items() if name != "curve_fit"), "this has changed"
assert found["curve_fit"] == [2.0, 1.0] and np.allclose(single, [3, 1.7], atol=1e-3), "this has changed"
PYTHON
