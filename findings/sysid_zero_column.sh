#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" "mujoco[sysid]==4.0.0" numpy==2.4.6
echo "guess:     a coordinate that stays 0, such as y of a planar robot, adds nothing to a fit of mujoco.sysid"
echo "behaviour: each column is divided by its norm: the residual is NaN, and the start values come back as the optimum"
python -W ignore - <<'PYTHON'
import contextlib
import io

import mujoco
import numpy as np
from mujoco import sysid

MJCF = """<mujoco><option timestep=".01" integrator="RK4" gravity="0 0 0"/>
<worldbody><body><joint name="x" type="slide" axis="1 0 0" stiffness="200"/><geom size=".05" mass="1"/><site name="s"/></body></worldbody>
<actuator><motor joint="x"/></actuator><sensor>{}</sensor></mujoco>"""


def stiffness(spec, parameter):
    spec.joint("x").stiffness[0] = parameter.value[0]


def fitted(sensor):
    """The stiffness that is found [N/m], from 150 on; and whether the residual is finite."""
    spec = mujoco.MjSpec.from_string(MJCF.format(sensor))
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
        seen.append(data.sensordata.copy())
        mujoco.mj_step(model, data)
    params = sysid.ParameterDict()
    params.add(sysid.Parameter("k", 150.0, 50.0, 500.0, modifier=stiffness))
    recorded = sysid.TimeSeries.from_names(times, np.array(seen), model)
    sequence = sysid.ModelSequences("ball", spec, "one", start, sysid.TimeSeries(times, controls), recorded)
    residual = sysid.build_residual_fn(models_sequences=[sequence], n_threads=1)
    with contextlib.redirect_stdout(io.StringIO()):
        best, _ = sysid.optimize(params, residual, optimizer="mujoco", verbose=False)
    left, _, _ = residual(best.as_vector(), best)
    return best["k"].value[0], bool(np.isfinite(np.ravel(left[0])).all())


along, everywhere = fitted('<jointpos joint="x"/>'), fitted('<framepos objtype="site" objname="s"/>')
print(f"seen:      {along[0]:.1f} N/m from x alone; {everywhere[0]:.1f} N/m from x, y and z; finite: {everywhere[1]}")
assert abs(along[0] - 200) < 5 and everywhere == (150.0, False), "this has changed"
PYTHON
