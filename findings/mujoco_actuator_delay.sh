#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0
echo "guess:     an actuator with a delay of five time steps acts five steps after its command"
echo "behaviour: times are sums of rounded steps, so a share of the commands takes six; 4.5 steps of delay are always five"
python - <<'PYTHON'
from collections import Counter

import mujoco

MJCF = """<mujoco><option timestep=".01"/>
  <worldbody><body><joint name="j" type="slide"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="j" delay="{}" nsample="10"/></actuator></mujoco>"""


def steps_of(delay):
    model = mujoco.MjModel.from_xml_string(MJCF.format(delay))
    data, found = mujoco.MjData(model), Counter()
    for number in range(200):
        data.ctrl[0] = 1 - data.ctrl[0]
        passed = 0
        while data.actuator_force[0] != data.ctrl[0] or not passed:
            mujoco.mj_step(model, data)
            passed += 1
        found[passed - 1] += 1
        for _ in range(20 - passed):
            mujoco.mj_step(model, data)
    return dict(sorted(found.items()))


whole, half = steps_of(0.05), steps_of(0.045)
print(f"seen:      steps -> commands: {whole} for 0.05 s, {half} for 0.045 s")
assert set(whole) == {5, 6} and set(half) == {5}, "this has changed"
PYTHON
