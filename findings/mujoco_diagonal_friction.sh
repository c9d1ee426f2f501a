#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     a friction of 0.6 holds a box that is pushed sideways with half its weight, in each direction"
echo "behaviour: with the default cone, a pyramid, only along the axes: between them it holds 0.42; cone=\"elliptic\" holds in each"
python - <<'PYTHON'
import mujoco
import numpy as np

MJCF = """<mujoco><option cone="{}"/><worldbody><geom type="plane" size="5 5 1" friction=".6"/>
  <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1" friction=".6"/></body></worldbody></mujoco>"""


def moved(cone, degrees):
    """Millimetres in 1 s of a push with half the weight, after 1 s at rest."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(cone))
    data = mujoco.MjData(model)
    while data.time < 2:
        if data.time > 1:
            angle = np.radians(degrees)
            data.xfrc_applied[1, :2] = 0.5 * 9.81 * np.array([np.cos(angle), np.sin(angle)])
        mujoco.mj_step(model, data)
    return round(1000 * float(np.hypot(*data.qpos[:2])))


pyramid, ellipse = ([moved(cone, degrees) for degrees in (0, 22.5, 45, 90)] for cone in ("pyramidal", "elliptic"))
print(f"seen:      millimetres at 0, 22.5, 45 and 90 degrees: {pyramid}, with an elliptic cone {ellipse}")
assert max(pyramid[0], pyramid[3]) < 10 and min(pyramid[1:3]) > 100 and max(ellipse) < 10, "this has changed"
PYTHON
