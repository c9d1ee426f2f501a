#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" scipy==1.17.1 numpy==2.4.6
echo "guess:     dlsim with the times of its inputs gives as many outputs, at these times"
echo "behaviour: if t[-1] / dt is just below a whole number, one step is lost, and inputs from between the samples are applied"
python - <<'PYTHON'
import numpy as np
from scipy.signal import dlsim

system = (np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0]]), np.array([[0.0]]), 0.1)
inputs = [1.0, 2.0, 3.0, 4.0]
plain, timed = dlsim(system, inputs), dlsim(system, inputs, t=[0.0, 0.1, 0.2, 0.3])
hundredth = (*system[:4], 0.01)
lost = [n for n in range(2, 201) if len(dlsim(hundredth, np.ones(n), t=np.arange(n) * 0.01)[0]) != n]
print(f"seen:      without times {plain[1].ravel().tolist()} at {plain[0].round(9).tolist()};")
print(f"           with times {timed[1].ravel().tolist()} at {timed[0].round(9).tolist()};")
print(f"           logs of 2 to 200 rows at 100 Hz, arange(n) * 0.01, that lose one: {lost}")
assert np.allclose(plain[1].ravel(), [0, 1, 2.5, 4.25]), "this has changed"
assert np.allclose(timed[0], [0, 0.15, 0.3]) and np.allclose(timed[1].ravel(), [0, 1, 3]), "this has changed"
assert lost[:3] == [30, 59, 60], "this has changed"
PYTHON
