#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco-mjx==3.17.0 mujoco==4.0.0 jax==0.10.2 numpy==2.4.6
echo "guess:     a weight on a slack cable falls with g in MJX, with each integrator, as in MuJoCo"
echo "behaviour: under implicitfast the damping in a winch's biasprm brakes it, although forcerange cuts the force off at 0"
JAX_PLATFORMS=cpu python -W ignore - <<'PYTHON'
import jax
import mujoco
import numpy as np
from mujoco import mjx

jax.config.update("jax_enable_x64", True)
MJCF = """<mujoco><option timestep=".005" integrator="{}"/>
  <worldbody><site name="drum"/><body pos="0 0 -1"><freejoint/><geom size=".1" mass="1"/><site name="hook"/></body></worldbody>
  <tendon><spatial name="cable"><site site="drum"/><site site="hook"/></spatial></tendon>
  <actuator><general tendon="cable" dyntype="integrator" gainprm="2000" biastype="affine" biasprm="0 -2000 -1000"
    forcelimited="true" forcerange="-500 0" actlimited="true" actrange="0 3"/></actuator>
  <keyframe><key qpos="0 0 -1 1 0 0 0" act="2"/></keyframe></mujoco>"""


def fallen(integrator):
    """Metres after .2 s in MuJoCo and in MJX, and the largest force of the winch in MJX [N]."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(integrator))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    there, state, step, forces = mjx.put_model(model), mjx.put_data(model, data), jax.jit(mjx.step), []
    for _ in range(40):
        mujoco.mj_step(model, data)
        state = step(there, state)
        forces.append(abs(float(state.qfrc_actuator[2])))
    return -1 - data.qpos[2], -1 - float(state.qpos[2]), max(forces)


euler, implicit = fallen("Euler"), fallen("implicitfast")
print(f"seen:      after 0.2 s, {9.81 / 2 * 0.04:.3f} m in free fall: Euler {euler[0]:.3f} m in MuJoCo and {euler[1]:.3f} m in MJX,")
print(f"           implicitfast {implicit[0]:.3f} and {implicit[1]:.3f} m; forces of the winch in MJX {implicit[2]} N")
assert abs(euler[1] - euler[0]) < 1e-6 and implicit[0] > 0.19 and implicit[1] < 0.05 and implicit[2] == 0, "this has changed"
PYTHON
