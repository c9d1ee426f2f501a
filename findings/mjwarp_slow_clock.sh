#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco-warp==4.0.0 mujoco==4.0.0 warp-lang==1.19.0 numpy==2.4.6
echo "guess:     two hundred steps of 5 ms are a second, in the first hour and in the fifth"
echo "behaviour: the clock of MuJoCo Warp is a float32, to which each step is added: after an hour it runs 2 % too slowly, after five 17 % too fast"
python - <<'PYTHON' | grep -v "^Module\|^Warp\|^ "
import mujoco
import mujoco_warp
import warp

warp.config.quiet = True
model = mujoco.MjModel.from_xml_string('<mujoco><option timestep=".005"/><worldbody><body><joint type="slide"/><geom size=".1"/></body></worldbody></mujoco>')
on_device, passed = mujoco_warp.put_model(model), {}
for hours in (0, 1, 5):
    data = mujoco.MjData(model)
    data.time = 3600.0 * hours
    device_data = mujoco_warp.put_data(model, data)
    for _ in range(200):
        mujoco.mj_step(model, data)
        mujoco_warp.step(on_device, device_data)
    passed[hours] = (round(data.time - 3600 * hours, 3), round(float(device_data.time.numpy()[0]) - 3600 * hours, 3))
print(f"seen:      seconds of 200 steps by hours before, MuJoCo and MuJoCo Warp: {passed}")
assert passed[0] == (1, 1) and passed[1] == (1, 0.977) and passed[5] == (1, 1.172), "this has changed"
PYTHON
