#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pysindy==2.1.0 numpy==2.4.6 scipy==1.17.1 scikit-learn==1.9.1
echo "guess:     a model x' = u that is simulated with recorded commands stays at rest until the first command that is not 0"
echo "behaviour: it moves before, and back, and on afterwards: the commands become a cubic spline, which swings around each step"
python -W ignore - <<'PYTHON'
import numpy as np
import pysindy

times = np.arange(0, 4, 0.01)
commands = np.sin(3 * times)[:, None]
model = pysindy.SINDy(feature_library=pysindy.PolynomialLibrary(1, include_bias=False))
model.fit(np.cumsum(commands, axis=0) * 0.01, t=times, u=commands)

times = np.arange(0, 2.01, 0.1)
steps = ((times >= 0.45) & (times < 0.95)).astype(float)
speeds = np.diff(model.simulate(np.zeros(1), times, u=steps[:, None])[:, 0]) / 0.1
held = np.diff(model.simulate(np.zeros(1), times, u=lambda t: np.atleast_1d(1.0 * (0.5 <= t < 1.0)), integrator_kws={"max_step": 0.01})[:, 0]) / 0.1
print(f"seen:      commands {steps[:13].astype(int).tolist()} at 10 Hz; speeds between them {speeds[:12].round(3).tolist()}; with a function that holds them {held[:12].round(2).tolist()}")
assert abs(speeds[:4]).max() > 0.05 and speeds.max() > 1.05 and abs(held[:4]).max() < 1e-3 and held.max() < 1.001, "this has changed"
PYTHON
