#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0
echo "guess:     a tendon that only pulls (springlength '0 L') does nothing while it is slack"
echo "behaviour: its damping acts all the same: a slack tendon that shortens pushes its ends apart"
python - <<'PYTHON'
import mujoco

model = mujoco.MjModel.from_xml_string(
    """<mujoco><option gravity="0 0 0"/>
    <worldbody><site name="a"/>
      <body pos="1 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1" contype="0" conaffinity="0"/><site name="b"/></body>
    </worldbody>
    <tendon><spatial stiffness="1000" damping="50" springlength="0 2"><site site="a"/><site site="b"/></spatial></tendon></mujoco>"""
)
data = mujoco.MjData(model)
data.qvel[0] = -1.0  # towards the anchor; the tendon is 1 m long and slack up to 2 m
mujoco.mj_forward(model, data)
print(f"seen:      spring {data.qfrc_spring[0]:g} N, damper {data.qfrc_damper[0]:g} N, which pushes the body away")
assert data.qfrc_spring[0] == 0.0 and data.qfrc_damper[0] == 50.0, "this has changed"
PYTHON
