#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" scikit-learn==1.9.1 numpy==2.4.6
echo "guess:     HuberRegressor finds the same stiffness from stretches in metres and in millimetres"
echo "behaviour: alpha=0.0001 times the square of the stiffness is added to the cost: in N/m 20000 becomes 3000, without a warning; with alpha=0 it stays"
python - <<'PYTHON'
import warnings

import numpy as np
from sklearn.linear_model import HuberRegressor

warnings.simplefilter("error")
random = np.random.default_rng(0)
stretches = random.uniform(0, 0.005, (200, 1))  # m
tensions = 20000 * stretches[:, 0] + random.normal(0, 1, 200)  # N
found = {}
for unit, scale in (("m", 1), ("mm", 1000)):
    for alpha in (None, 0.0):
        options = {} if alpha is None else {"alpha": alpha}
        fit = HuberRegressor(max_iter=1000, **options).fit(stretches * scale, tensions)
        found[unit, alpha] = round(float(fit.coef_[0] * scale)), round(float(fit.intercept_), 1)
print(f"seen:      stiffness of 20000 N/m, and tension [N] without a stretch, by unit of the stretches and alpha: {found}")
assert found["m", None][0] < 5000 and found["m", None][1] > 20, "this has changed"
assert all(abs(found[case][0] - 20000) < 300 for case in (("mm", None), ("m", 0.0), ("mm", 0.0))), "this has changed"
PYTHON
