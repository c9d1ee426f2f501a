#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     mjd_transitionFD differentiates inward at an end of actrange, as it does at an end of ctrlrange"
echo "behaviour: it steps over the end: centered differences are half as large, forward ones zero at the upper end"
python - <<'PYTHON'
import mujoco
import numpy as np

MJCF = """<mujoco><worldbody><body><joint name="j" type="slide"/><geom size=".1" mass="1"/></body></worldbody>
<actuator><general joint="j" dyntype="integrator" gainprm="1" actlimited="true" actrange="-1 1"
  ctrllimited="true" ctrlrange="-1 1"/></actuator></mujoco>"""
model = mujoco.MjModel.from_xml_string(MJCF)


def derivatives(activation, control, centered):
    """Of the next activation by the activation, and by the control over the time step."""
    data = mujoco.MjData(model)
    data.act[0], data.ctrl[0] = activation, control
    states, controls = np.zeros((3, 3)), np.zeros((3, 1))
    mujoco.mjd_transitionFD(model, data, 1e-6, centered, states, controls, None, None)
    return round(float(states[2, 2]), 4), round(float(controls[2, 0] / model.opt.timestep), 4)


inside, control_end = derivatives(0.0, 0.0, True), derivatives(0.0, 1.0, True)
centered, forward = derivatives(1.0, 0.0, True), derivatives(1.0, 0.0, False)
print(f"seen:      inside {inside}, control at its end {control_end}; activation at its end {centered}, forward {forward}")
assert (inside, control_end, centered, forward) == ((1, 1), (1, 1), (0.5, 0.5), (0, 0)), "this has changed"
PYTHON
