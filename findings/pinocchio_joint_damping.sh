#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pin==4.1.0 numpy==2.4.6
echo "guess:     damping and friction of a URDF's joints, which are read, act in aba and rnea; a mimic joint follows the other"
echo "behaviour: both dynamics ignore them (armature counts), and a mimic joint is free, unless mimic=True"
python - <<'PYTHON'
import numpy as np
import pinocchio

LINK = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
JOINT = """<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/>
<dynamics damping="2" friction="0.5"/>{3}</joint>"""
URDF = "<robot name='r'><link name='base'/>" + LINK.format("a") + LINK.format("b")
URDF += JOINT.format("first", "base", "a", "") + JOINT.format("second", "a", "b", '<mimic joint="first"/>') + "</robot>"

model = pinocchio.buildModelFromXML(URDF)
following = pinocchio.buildModelFromXML(URDF, mimic=True)
data, q, zero, one = model.createData(), pinocchio.neutral(model), np.zeros(model.nv), np.ones(model.nv)
acceleration = pinocchio.aba(model, data, q, one, zero).copy()
torque = pinocchio.rnea(model, data, q, one, zero).copy()
heavy = pinocchio.Model(model)
heavy.armature = 0.5 * one
added = pinocchio.rnea(heavy, heavy.createData(), q, zero, one) - pinocchio.rnea(model, data, q, zero, one)
print(f"seen:      damping {model.damping.tolist()}, at 1 rad/s acceleration {acceleration.tolist()} and torque {torque.tolist()};")
print(f"           torque of an armature of .5 {added.round(6).tolist()}; degrees of freedom {model.nv}, with mimic=True {following.nv}")
assert (model.damping == 2).all() and not acceleration.any() and not torque.any(), "this has changed"
assert np.allclose(added, 0.5) and (model.nv, following.nv) == (2, 1), "this has changed"
PYTHON
