#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pybullet==3.2.7 mujoco==4.0.0 numpy==2.4.6
echo "guess:     loadMJCF gives bodies the masses and joints the damping that the file states, or says that it does not"
echo "behaviour: mass and density of geoms are ignored without a word, all have 1000 kg/m3, and joints have no damping"
python - <<'PYTHON' 2> errors.txt || { cat errors.txt; exit 1; }
import mujoco
import pybullet

MJCF = """<mujoco><worldbody>
<body name="mass" pos="0 0 1"><joint type="hinge" name="a" axis="0 1 0" damping=".5"/><geom type="capsule" size=".05 .2" mass=".3"/></body>
<body name="density" pos="1 0 1"><joint type="hinge" name="b" axis="0 1 0" damping=".5"/><geom type="box" size=".1 .1 .3" density="500"/></body>
<body name="inertial" pos="2 0 1"><joint type="hinge" name="c" axis="0 1 0" damping=".5"/><inertial pos="0 0 0" mass="2" diaginertia=".1 .1 .1"/>
<geom type="box" size=".1 .1 .3"/></body>
</worldbody></mujoco>"""
with open("rods.xml", "w") as file:
    file.write(MJCF)
model = mujoco.MjModel.from_xml_path("rods.xml")
pybullet.connect(pybullet.DIRECT)
bodies = pybullet.loadMJCF("rods.xml")
masses = [sum(pybullet.getDynamicsInfo(body, link)[0] for link in range(-1, pybullet.getNumJoints(body))) for body in bodies]
damping = [pybullet.getJointInfo(body, 0)[6] for body in bodies]
print(f"seen:      masses by mass=, density= and <inertial> {[round(mass, 3) for mass in masses]}, damping {damping};")
print(f"           in MuJoCo {model.body_mass[1:].round(3).tolist()}, damping {model.dof_damping.tolist()}")
assert [round(mass, 3) for mass in masses] == [3.665, 24, 2] and damping == [0, 0, 0], "this has changed"
assert model.body_mass[1:].round(3).tolist() == [0.3, 12, 2] and model.dof_damping.tolist() == [0.5] * 3, "this has changed"
PYTHON
