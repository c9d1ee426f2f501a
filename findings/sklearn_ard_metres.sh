#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" scikit-learn==1.9.1 numpy==2.4.6
echo "guess:     ARDRegression and BayesianRidge find in metres what they find in millimetres"
echo "behaviour: weights below 0.01, in metres 1 cm, count as none, and 1e-6 is added to sums of squares: in metres nothing is left, or its deviation is 14 times too large"
python - <<'PYTHON'
import numpy as np
from sklearn.linear_model import ARDRegression, BayesianRidge

random = np.random.default_rng(0)
inputs = random.uniform(-1, 1, (100, 3))
places = inputs @ [0.1, 0.2, 0.3] + random.normal(0, 0.01, 100)  # mm
weights, deviations = {}, {}
for name, unit in (("mm", 1.0), ("m", 1e-3)):
    ridge, relevant = BayesianRidge().fit(inputs, places * unit), ARDRegression().fit(inputs, places * unit)
    weights[name] = [round(float(each), 3) for each in relevant.coef_ / unit]
    deviations[name] = round(float(ridge.alpha_**-0.5 / unit), 4)
print(f"seen:      weights 0.1, 0.2, 0.3 mm by ARDRegression, in mm, as fitted in mm and m: {weights}; noise of 0.01 mm by BayesianRidge {deviations}")
assert np.allclose(weights["mm"], [0.1, 0.2, 0.3], atol=0.01) and not any(weights["m"]), "this has changed"
assert abs(deviations["mm"] - 0.01) < 0.002 and deviations["m"] > 0.1, "this has changed"
PYTHON
