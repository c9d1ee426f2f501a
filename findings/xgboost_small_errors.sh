#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" xgboost-cpu==3.2.0 scikit-learn==1.9.1 numpy==2.4.6
echo "guess:     XGBRegressor learns errors of a model as well in metres as in millimetres"
echo "behaviour: a split that gains less than 1e-6, in the square of the unit, is none: of errors of 0.1 mm in metres two thirds are not learned, of 0.01 mm all, without a word"
python - <<'PYTHON'
import numpy as np
from xgboost import XGBRegressor

random = np.random.default_rng(0)
inputs = random.normal(size=(2000, 4))
errors = np.sin(inputs[:, 0]) + inputs[:, 1] / 2
found = {}
for size in (1.0, 1e-3, 1e-4, 1e-5):  # m
    model = XGBRegressor(n_estimators=100, n_jobs=1).fit(inputs[:1000], errors[:1000] * size)
    left = model.predict(inputs[1000:]) / size - errors[1000:]
    found[size] = round(float(np.std(left) / np.std(errors)), 2)
print(f"seen:      share of smooth errors that is left on held-out rows, by their size: {found}")
assert found[1.0] < 0.15 and found[1e-4] > 0.4 and found[1e-5] > 0.95, "this has changed"
PYTHON
