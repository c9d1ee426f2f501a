#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     model.nu is the number of actuators, and data.ctrl[i] is the command of actuator i"
echo "behaviour: a <pid> takes two commands, a place and a speed: nu is more than nactuator, and later actuators' commands are not at their ids"
python - <<'PYTHON'
import mujoco
import numpy as np

MJCF = """<mujoco><worldbody><body><joint name="lift" type="slide"/><geom size=".1" mass="1"/></body>
<body pos="1 0 0"><joint name="drum" axis="0 0 1"/><geom size=".1" mass="1"/></body></worldbody>
<actuator>{first} joint="lift"/><motor name="motor" joint="drum"/></actuator></mujoco>"""
SERVOS = {"position": '<position name="servo" kp="100" kv="10"', "pid": '<pid name="servo" kp="100" kv="10"'}
seen = {}
for kind, servo in SERVOS.items():
    model = mujoco.MjModel.from_xml_string(MJCF.format(first=servo))
    data = mujoco.MjData(model)
    motor = model.actuator("motor").id
    data.ctrl[motor] = 1  # N m
    mujoco.mj_forward(model, data)
    seen[kind] = model.nactuator, model.nu, motor, data.actuator_force.tolist()
    data.ctrl[:] = 0
    data.actuator("motor").ctrl = 1
    mujoco.mj_forward(model, data)
    assert np.array_equal(data.actuator_force, [0, 1])
print(f"seen:      actuators, nu, id of the motor, forces of servo and motor where ctrl[id] is 1: {seen}")
assert seen["position"] == (2, 2, 1, [0, 1]) and seen["pid"] == (2, 3, 1, [10, 0]), "this has changed"
PYTHON
