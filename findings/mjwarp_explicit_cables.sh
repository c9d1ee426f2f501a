#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco-warp==4.0.0 mujoco==4.0.0 warp-lang==1.19.0 numpy==2.4.6
echo "guess:     a damped cable that is calm under implicitfast in MuJoCo is calm under implicitfast in MuJoCo Warp"
echo "behaviour: between two free bodies its damping is explicit there, as under Euler: what MuJoCo damps to a half at each step grows four times"
python - <<'PYTHON' | grep -v "^Module\|^Warp\|^ "
import mujoco
import mujoco_warp
import numpy as np
import warp

warp.config.quiet = True
MJCF = """<mujoco><option timestep=".005" gravity="0 0 0" integrator="implicitfast"/><worldbody>
<body><freejoint/><geom size=".05" mass="1"/><site name="rod"/></body>
<body pos="1 0 0"><freejoint/><geom size=".05" mass="1"/><site name="node"/></body></worldbody>
<tendon><spatial damping="500" springlength="1"><site site="rod"/><site site="node"/></spatial></tendon></mujoco>"""

model = mujoco.MjModel.from_xml_string(MJCF)
data = mujoco.MjData(model)
data.qvel[0] = 1.0
on_device, device_data = mujoco_warp.put_model(model), mujoco_warp.put_data(model, data)
relative = {"MuJoCo": [], "MuJoCo Warp": []}
for _ in range(4):
    mujoco.mj_step(model, data)
    mujoco_warp.step(on_device, device_data)
    for name, velocities in (("MuJoCo", data.qvel), ("MuJoCo Warp", device_data.qvel.numpy()[0])):
        relative[name].append(round(float(velocities[0] - velocities[6]), 3))
print(f"seen:      relative velocity, 1 m/s at the start: {relative}")
assert np.allclose(relative["MuJoCo Warp"], [-4, 16, -64, 256], rtol=0.01) and max(map(abs, relative["MuJoCo"])) < 0.5, "this has changed"
PYTHON
