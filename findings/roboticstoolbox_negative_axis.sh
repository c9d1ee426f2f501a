#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" roboticstoolbox-python==1.5.0 numpy==2.4.6
echo "guess:     torques of an arm from a URDF are right, as its kinematics are"
echo "behaviour: not of joints whose axis is negative: where they turn is right, but the torque that holds them has the other sign, and inertias between joints, too"
python -W ignore::DeprecationWarning - <<'PYTHON'
from pathlib import Path

import numpy as np
from roboticstoolbox import Robot

BODY = '<link name="{name}"><inertial><origin xyz="0.2 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
JOINT = '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{x} 0 0"/><axis xyz="0 {axis} 0"/><limit effort="9" velocity="9" lower="-3" upper="3"/></joint>'
place = np.array([0.4, 0.3])
found = {}
for axis in (1, -1):
    parts = [BODY.format(name="upper"), BODY.format(name="lower"), JOINT.format(name="j1", parent="base", child="upper", x=0, axis=1), JOINT.format(name="j2", parent="upper", child="lower", x=0.4, axis=axis)]
    Path("arm.urdf").write_text(f'<robot name="arm"><link name="base"/>{"".join(parts)}</robot>')
    arm = Robot.URDF(str(Path("arm.urdf").resolve()))

    def centres(angles):
        return np.array([arm.fkine(angles, end=name).A @ [0.2, 0, 0, 1] for name in ("upper", "lower")])[:, :3]

    def rate(function, joint, step=1e-6):
        change = step * np.eye(2)[joint]
        return (function(place + change) - function(place - change)) / (2 * step)

    rates = np.array([rate(centres, joint) for joint in range(2)])
    spins = np.array([[1, 1], [0, axis]])  # of each joint, of both bodies about y [rad/s per rad/s]
    exact = {"torque": 9.81 * rates[:, :, 2].sum(axis=1), "inertia": np.einsum("iba,jba->ij", rates, rates) + 0.01 * spins @ spins.T}
    seen = {"torque": arm.gravload(place), "inertia": arm.inertia(place)}
    for name in exact:
        found[axis, name] = exact[name].round(3).tolist(), np.asarray(seen[name]).round(3).tolist()
print(f"seen:      by the sign of the second joint's axis: what follows from fkine by differences, and what is returned: {found}")
assert all(np.allclose(*found[1, name], atol=0.002) for name in ("torque", "inertia")), "this has changed"
exact, seen = (np.array(each) for each in found[-1, "torque"])
assert abs(exact[1]) > 1 and np.isclose(seen[1], -exact[1], atol=0.002), "this has changed"
exact, seen = (np.array(each) for each in found[-1, "inertia"])
assert abs(exact[0, 1]) > 0.05 and np.isclose(seen[0, 1], -exact[0, 1], atol=0.002), "this has changed"
PYTHON
