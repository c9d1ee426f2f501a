#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" control==0.10.2 numpy==2.4.6 scipy==1.17.1
echo "guess:     eigensys_realization makes from the impulse response of a sampled system that system again"
echo "behaviour: the response is to an impulse of height 1 / dt, which is not taken back: at 100 Hz the gain is 100 times too large, and dt is lost"
python - <<'PYTHON'
import control
import numpy as np

system = control.ss([[0.9, 0.1], [-0.1, 0.8]], [[0.0], [0.1]], [[1.0, 0.0]], [[0.0]], 0.01)
response = control.impulse_response(system, T=2.0)
again, _ = control.eigensys_realization(response, r=2)
gains = float(control.dcgain(system)), float(control.dcgain(again))
poles = np.sort_complex(system.poles()), np.sort_complex(again.poles())
print(f"seen:      gain {gains[0]:.4f} became {gains[1]:.4f}, poles {np.round(poles[0], 4)} became {np.round(poles[1], 4)}, dt {system.dt} became {again.dt}")
assert np.allclose(*poles, atol=1e-5) and np.isclose(gains[1], 100 * gains[0]) and again.dt is True, "this has changed"
PYTHON
