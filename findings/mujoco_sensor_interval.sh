#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     a sensor with an interval of five time steps has a new reading at each fifth step"
echo "behaviour: without nsample at each step, without a word; with it, now and then after four or six"
python - <<'PYTHON'
from collections import Counter

import mujoco
import numpy as np

MJCF = """<mujoco><option timestep=".01"/>
<worldbody><body><joint name="j" type="slide" axis="0 0 1"/><geom size=".1"/></body></worldbody>
<sensor><jointpos joint="j" interval=".05" {}/></sensor></mujoco>"""


def steps_between_readings(more):
    model = mujoco.MjModel.from_xml_string(MJCF.format(more))
    data, read = mujoco.MjData(model), []
    for _ in range(200):
        mujoco.mj_step(model, data)
        read.append(float(data.sensordata[0]))
    return dict(sorted(Counter(np.diff(np.flatnonzero(np.diff(read))).tolist()).items()))


without, sampled = steps_between_readings(""), steps_between_readings('nsample="1"')
print(f"seen:      steps -> readings after so many: {without} without nsample, {sampled} with nsample=1")
assert set(without) == {1} and set(sampled) > {5}, "this has changed"
PYTHON
