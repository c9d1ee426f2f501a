#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0
echo "guess:     mj_resetData puts an activation into its actrange"
echo "behaviour: it is 0, also where actrange begins at 0.8, and the first step pulls with it"
python - <<'PYTHON'
import mujoco

model = mujoco.MjModel.from_xml_string(
    """<mujoco><option gravity="0 0 0"/>
    <worldbody><site name="a"/>
      <body pos="1 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1" contype="0" conaffinity="0"/><site name="b"/></body>
    </worldbody>
    <tendon><spatial name="c"><site site="a"/><site site="b"/></spatial></tendon>
    <actuator><general tendon="c" dyntype="integrator" actrange=".8 1.2" gainprm="1000" biastype="affine" biasprm="0 -1000"/>
    </actuator></mujoco>"""
)
data = mujoco.MjData(model)
mujoco.mj_resetData(model, data)
begun = data.act[0]
mujoco.mj_step(model, data)
print(f"seen:      activation {begun:g}, force of the first step {data.actuator_force[0]:g} N, activation then {data.act[0]:g}")
assert (begun, data.actuator_force[0], data.act[0]) == (0.0, -1000.0, 0.8), "this has changed"
PYTHON
