#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
echo "guess:     Pinocchio gives the bodies of an MJCF the masses that MuJoCo gives them"
echo "behaviour: a geom that touches nothing has no mass there, and a mass in a default class is replaced by 1000 kg/m3"
python - <<'PYTHON'
import mujoco
import pinocchio

MJCF = """<mujoco><default><default class="cap"><geom mass="1"/></default></default><worldbody><body name="rod"><freejoint/>
<geom type="box" size=".1 .2 .3" mass="2"/><geom size=".1" {0}/></body></worldbody></mujoco>"""


def masses(attributes):
    text = MJCF.format(attributes)
    with open("rod.xml", "w") as file:
        file.write(text)
    read, model = pinocchio.buildModelFromMJCF("rod.xml"), mujoco.MjModel.from_xml_string(text)
    return round(sum(inertia.mass for inertia in read.inertias), 3), round(float(model.body_mass.sum()), 3)


found = {each: masses(each) for each in ('mass="1"', 'mass="1" contype="0" conaffinity="0"', 'class="cap"')}
print(f"seen:      a box of 2 kg and a ball; (Pinocchio, MuJoCo) in kg by what the ball has: {found}")
assert list(found.values()) == [(3, 3), (2, 3), (6.189, 3)], "this has changed"
PYTHON
