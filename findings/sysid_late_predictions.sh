#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" "mujoco[sysid]==4.0.0" numpy==2.4.6
echo "guess:     mujoco.sysid finds the numbers of a simulation from its own sensor values, with the times they were read at"
echo "behaviour: its predictions carry the time after a step with the values before it: the fit makes up for one step"
python - <<'PYTHON'
import contextlib
import io

import mujoco
import numpy as np
from mujoco import sysid

spec = mujoco.MjSpec.from_string(
    """<mujoco><option timestep=".01" integrator="RK4"/>
    <worldbody><body><joint name="x" type="slide" axis="1 0 0" stiffness="200" damping="1"/><geom size=".05" mass="1"/></body></worldbody>
    <actuator><motor joint="x"/></actuator><sensor><jointpos joint="x" name="position"/></sensor></mujoco>"""
)
model, kind = spec.compile(), mujoco.mjtState.mjSTATE_FULLPHYSICS
data, start = mujoco.MjData(model), np.zeros(mujoco.mj_stateSize(model, kind))
data.qpos[0] = 0.1
mujoco.mj_getState(model, data, start, kind)
times = 0.01 * np.arange(201)
controls = 20 * np.sin(6 * times)[:, None]
seen = []
for control in controls:
    data.ctrl[:] = control
    mujoco.mj_forward(model, data)
    seen.append(data.sensordata.copy())  # at data.time
    mujoco.mj_step(model, data)


def stiffness(spec, parameter):
    spec.joint("x").stiffness[0] = parameter.value[0]


def damping(spec, parameter):
    spec.joint("x").damping[0] = parameter.value[0]


params = sysid.ParameterDict()
params.add(sysid.Parameter("k", 150.0, 50.0, 500.0, modifier=stiffness))
params.add(sysid.Parameter("c", 0.5, 0.01, 10.0, modifier=damping))
recorded = sysid.TimeSeries.from_names(times, np.array(seen), model)
sequence = sysid.ModelSequences("ball", spec, "one", start, sysid.TimeSeries(times, controls), recorded)
residual = sysid.build_residual_fn(models_sequences=[sequence], n_threads=1)
with contextlib.redirect_stdout(io.StringIO()):
    best, result = sysid.optimize(params, residual, optimizer="mujoco", verbose=False)
left, _, _ = residual(best.as_vector(), best)
_, half = sysid.calculate_intervals(left, result.jac)
found = best["k"].value[0]
print(f"seen:      stiffness {found:.1f} +- {half[0]:.1f} N/m instead of 200, damping {best['c'].value[0]:.3f} instead of 1")
assert found - half[0] > 200.0, "this has changed"
PYTHON
