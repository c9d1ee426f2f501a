#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" control==0.10.2 numpy==2.4.6 scipy==1.17.1
echo "guess:     input_output_response at the times of the inputs shows a pulse of half a second, 50 samples, after 20 s at rest"
echo "behaviour: its integrator steps over the pulse: zero throughout; with max_step it is as forced_response has it"
python - <<'PYTHON'
import control
import numpy as np

times = np.arange(0.0, 60.0, 0.01)
pulse = ((times >= 20.0) & (times < 20.5)).astype(float)
system = control.nlsys(lambda t, x, u, params: 2 * (u - x), lambda t, x, u, params: x, inputs=1, outputs=1, states=1)
plain = control.input_output_response(system, times, pulse, 0.0).outputs.max()
short = control.input_output_response(system, times, pulse, 0.0, solve_ivp_kwargs={"max_step": 0.02}).outputs.max()
linear = control.forced_response(control.ss(-2.0, 2.0, 1.0, 0.0), times, pulse).outputs.max()
print(f"seen:      highest output {plain:.3f}, with max_step .02 s {short:.3f}, of forced_response {linear:.3f}, exact {1 - np.exp(-1):.3f}")
assert plain == 0 and abs(short - 0.632) < 0.01 and abs(linear - 0.632) < 0.01, "this has changed"
PYTHON
