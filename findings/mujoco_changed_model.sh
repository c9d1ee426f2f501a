#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0
echo "guess:     after a change of body_mass or geom_size, centres of mass and contacts are those of the changed model"
echo "behaviour: until mj_setConst the centre of mass of two bodies is 1.5 m above both, and balls overlap by 10 cm without a contact"
python - <<'PYTHON'
import mujoco

TOWER = """<mujoco><worldbody><body name="low" pos="0 0 1"><freejoint/><geom size=".1" mass="1"/>
  <body pos="0 0 1"><joint/><geom size=".1" mass="1"/></body></body></worldbody>
<sensor><subtreecom body="low"/><subtreelinvel body="low"/></sensor></mujoco>"""
BALLS = """<mujoco><worldbody><geom size="{0}"/><body pos=".5 0 0"><joint type="slide"/><geom size="{0}"/></body></worldbody></mujoco>"""


def settled(model, constants):
    if constants:
        mujoco.mj_setConst(model, mujoco.MjData(model))
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    mujoco.mj_forward(model, data)
    return data


def centre(mass, constants=False):
    """Height and speed of the centre of mass of bodies at 1 and 2 m that move with 1 m/s."""
    model = mujoco.MjModel.from_xml_string(TOWER)
    model.body_mass[2] = mass
    return settled(model, constants).sensordata[2:4].round(4).tolist()


def contacts(compiled, changed, constants=False):
    model = mujoco.MjModel.from_xml_string(BALLS.format(compiled))
    model.geom_size[:, 0] = changed
    return settled(model, constants).ncon


centres, balls = [centre(1.0), centre(3.0), centre(3.0, True)], [contacts(0.3, 0.3), contacts(0.1, 0.3), contacts(0.1, 0.3, True)]
print(f"seen:      (height, speed) with 1 kg above, changed to 3 kg, after mj_setConst: {centres};")
print(f"           contacts of balls of .3 m, .5 m apart, compiled, changed from .1 m, after mj_setConst: {balls}")
assert centres == [[1.5, 1.0], [3.5, 2.0], [1.75, 1.0]] and balls == [1, 0, 1], "this has changed"
PYTHON
