#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     a tendon with actuatorfrcrange=\"-50 0\" is never pushed, and pulls with 50 N at most, whatever its actuators do"
echo "behaviour: the range scales what actuators ask for, and their own forceranges clamp only then: it is pushed with 190 N, and pulled with 150 N"
python - <<'PYTHON'
import mujoco
import numpy as np

MJCF = """<mujoco><option gravity="0 0 0"/><worldbody><site name="anchor" pos="0 0 1"/>
<body><joint type="slide" axis="0 0 1"/><geom size=".05" mass="1"/><site name="load"/></body></worldbody>
<tendon><spatial name="cable" actuatorfrclimited="true" actuatorfrcrange="-50 0"><site site="anchor"/><site site="load"/></spatial></tendon>
<actuator><motor tendon="cable" forcerange="{}"/><motor tendon="cable"/></actuator>
<sensor><tendonactuatorfrc tendon="cable"/></sensor></mujoco>"""


def force(forcerange, *commands):
    """Force [N] of the tendon's actuators by its sensor; negative forces pull. The load of 1 kg moves by it."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(forcerange))
    data = mujoco.MjData(model)
    data.ctrl[:] = commands
    mujoco.mj_forward(model, data)
    assert np.isclose(data.qacc[0], -data.sensordata[0])
    return round(float(data.sensordata[0]), 3)


pushed, pulled = force("-100 0", -300, 290), force("0 100", 200, -250)
inside = force("-400 0", -300, 290), force("-400 0", -300, -290)
print(f"seen:      -300 and +290 N are -10 N: with a forcerange of -100 to 0, {pushed}; 200 and -250 N are -50 N: with 0 to 100, {pulled}; without clamps {inside}")
assert pushed == 190 and pulled == -150 and inside == (-10, -50), "this has changed"
PYTHON
