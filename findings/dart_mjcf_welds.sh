#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" dartpy==6.20.0 numpy==2.4.6
echo "guess:     DART's reader of MJCF makes a body with a free joint free, with the inertia of its geoms"
echo "behaviour: a freejoint becomes a weld to the world (a joint of type free does not), and each body has moments of 1 kg m2, without a word"
python - <<'PYTHON'
import os

import dartpy
import numpy as np

MJCF = """<mujoco><worldbody>
<body name="loose" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .3" mass="2"/></body>
<body name="free" pos="1 0 1"><joint type="free"/><geom type="box" size=".1 .1 .3" mass="2"/></body>
<body name="hinged" pos="2 0 1"><joint type="hinge" axis="0 1 0"/><geom type="box" size=".1 .1 .3" mass="2"/></body>
</worldbody></mujoco>"""
with open("rods.xml", "w") as file:
    file.write(MJCF)
world = dartpy.utils.MjcfParser.readWorld("file://" + os.path.abspath("rods.xml"))
found = {}
for name in ("loose", "free", "hinged"):
    body = next(world.getSkeleton(i).getBodyNode(0) for i in range(world.getNumSkeletons()) if world.getSkeleton(i).getBodyNode(0).getName() == name)
    found[name] = (body.getParentJoint().getType(), body.getMass(), np.diag(body.getInertia().getMoment()).tolist())
print(f"seen:      joint, mass, moments: {found}; those of the box are {[2 / 12 * (0.04 + 0.36)] * 2 + [2 / 12 * 0.08]}")
assert [found[name][0] for name in ("loose", "free", "hinged")] == ["WeldJoint", "FreeJoint", "RevoluteJoint"], "this has changed"
assert all(each[1:] == (2.0, [1.0, 1.0, 1.0]) for each in found.values()), "this has changed"
PYTHON
