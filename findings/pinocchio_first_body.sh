#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
echo "guess:     buildModelFromMJCF reads all bodies of a robot, or says that it cannot"
echo "behaviour: it reads the first body of the world and what hangs on it; other bodies are dropped without a word"
python - 2>&1 <<'PYTHON'
import mujoco
import pinocchio

ROD = '<body name="{0}" pos="{1} 0 1"><freejoint/><geom type="capsule" size=".03 .4" mass="{2}"/></body>'
MJCF = f"""<mujoco><worldbody>{ROD.format("a", 0, 1)}{ROD.format("b", 1, 2)}{ROD.format("c", 2, 4)}</worldbody></mujoco>"""

with open("rods.xml", "w") as file:
    file.write(MJCF)
read = pinocchio.buildModelFromMJCF("rods.xml")
model = mujoco.MjModel.from_xml_string(MJCF)
bodies = [frame.name for frame in read.frames if frame.type == pinocchio.FrameType.BODY]
mass = sum(inertia.mass for inertia in read.inertias)
print(f"seen:      MuJoCo has {model.nq} positions, {model.nbody - 1} bodies, {model.body_mass.sum():g} kg;")
print(f"           Pinocchio {read.nq} positions, the bodies {bodies}, {mass:g} kg")
assert (model.nq, read.nq, bodies, round(mass, 9)) == (21, 7, ["a"], 1.0), "this has changed"
PYTHON
