#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     a box that stands on a mocap body is carried along when this is moved, as on a tray"
echo "behaviour: a mocap body has no velocity for friction: the tray slides away under the box; surfacevel carries it"
python - <<'PYTHON'
import mujoco

MJCF = """<mujoco><worldbody>
  <body name="tray" mocap="true"><geom type="box" size="2 2 .1" {}/></body>
  <body pos="0 0 .2"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""


def carried(surface, speed):
    """Where the box is [m] after 2 s on a tray that is moved with a speed [m/s]."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(surface))
    data = mujoco.MjData(model)
    while data.time < 2:
        data.mocap_pos[0, 0] = speed * data.time
        mujoco.mj_step(model, data)
    return data.qpos[0]


moved, belt = carried("", 0.5), carried('surfacevel=".5 0 0"', 0.0)
print(f"seen:      after 2 s at 0.5 m/s the box is at {moved:.3f} m on the tray, at {belt:.3f} m on a surface of that velocity")
assert abs(moved) < 0.01 and belt > 0.9, "this has changed"
PYTHON
