#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0
echo "guess:     a change of site_pos or body_ipos of a compiled model acts at the next step, as both are read at each step"
echo "behaviour: not if the site, or the centre of mass, was at its body's origin: it stays there, until mj_setConst"
python - <<'PYTHON'
import mujoco

MJCF = """<mujoco><worldbody><site name="anchor" pos="0 0 3"/>
<body pos="0 0 1"><joint axis="0 1 0"/><inertial pos="{0} 0 .1" mass="2" diaginertia=".1 .1 .1"/><site name="end" pos="{1} 0 0"/></body>
</worldbody><tendon><spatial><site site="anchor"/><site site="end"/></spatial></tendon></mujoco>"""
HEAVY = """<mujoco><worldbody><body pos="0 0 1"><joint axis="0 1 0"/><inertial pos="{0} 0 0" mass="2" diaginertia=".1 .1 .1"/></body>
</worldbody></mujoco>"""


def length(start, wanted, constants=False):
    """Of a cable whose end is moved to `wanted` metres beside the body's origin [m]."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(0, start))
    model.site_pos[1, 0] = wanted
    data = mujoco.MjData(model)
    if constants:
        mujoco.mj_setConst(model, data)
    mujoco.mj_forward(model, data)
    return round(float(data.ten_length[0]), 4)


def torque(start, wanted):
    """Of gravity, if the centre of mass is moved to `wanted` metres beside the joint [N m]."""
    model = mujoco.MjModel.from_xml_string(HEAVY.format(start))
    model.body_ipos[1, 0] = wanted
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return round(float(data.qfrc_bias[0]), 3)


lengths = [length(0.5, 0.5), length(0.1, 0.5), length(0.0, 0.5), length(0.0, 0.5, constants=True)]
torques = [torque(0.5, 0.5), torque(0.1, 0.5), torque(0.0, 0.5)]
print(f"seen:      length compiled, moved from .1 m, from 0, from 0 with mj_setConst: {lengths}; torque of gravity: {torques}")
assert lengths == [2.0616, 2.0616, 2.0, 2.0616] and torques == [-9.81, -9.81, 0.0], "this has changed"
PYTHON
