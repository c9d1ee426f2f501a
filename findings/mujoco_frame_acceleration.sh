#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     the sensor framelinacc is the rate of framelinvel, and the accelerometer that minus gravity, in its own axes"
echo "behaviour: framelinacc is minus gravity, too: 9.81 m/s2 upward at rest, 0 in a fall that gets faster by 9.81 m/s each second"
python - <<'PYTHON'
import mujoco
import numpy as np

MJCF = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/><site name="s"/></body></worldbody>
<sensor><framelinvel objtype="site" objname="s"/><framelinacc objtype="site" objname="s"/></sensor></mujoco>"""


def upward(height, seconds):
    """Rate of the sensed velocity, and the sensed acceleration, at the end [m/s2]."""
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qpos[2] = height
    seen = []
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        seen.append(data.sensordata[[2, 5]].copy())
    return (seen[-1][0] - seen[-2][0]) / model.opt.timestep, seen[-1][1]


rest, fall = upward(0.1, 2.0), upward(50.0, 1.0)
print(f"seen:      at rest {rest[1]:.2f} m/s2, velocity's rate {rest[0]:.2f}; falling {fall[1]:.2f}, velocity's rate {fall[0]:.2f}")
assert np.allclose(rest, [0, 9.81], atol=1e-3) and np.allclose(fall, [-9.81, 0], atol=1e-3), "this has changed"
PYTHON
