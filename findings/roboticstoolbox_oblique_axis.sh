#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" roboticstoolbox-python==1.5.0 numpy==2.4.6
echo "guess:     a joint of a URDF turns about its axis, whatever the axis, or the URDF is refused"
echo "behaviour: about an axis that is none of x, y and z it turns, but the frame of the child is another one, also where the joint is at 0, without a word"
python -W ignore::DeprecationWarning - <<'PYTHON'
from pathlib import Path

import numpy as np
from roboticstoolbox import Robot


def turned(axis, angle):
    """Rodrigues' rotation matrix."""
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


found = {}
for axis in ((0, 0, 1), (0, 1, 0), (0.6, 0, 0.8)):
    joint = f'<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 1"/><axis xyz="{axis[0]} {axis[1]} {axis[2]}"/><limit effort="9" velocity="9" lower="-3" upper="3"/></joint>'
    Path("arm.urdf").write_text(f'<robot name="arm"><link name="base"/><link name="arm"/>{joint}</robot>')
    arm = Robot.URDF(str(Path("arm.urdf").resolve()))
    for angle in (0.0, 1.0):
        seen, exact = arm.fkine([angle]).A[:3, :3], turned(np.array(axis, float), angle)
        off = np.degrees(np.arccos(np.clip((np.trace(seen.T @ exact) - 1) / 2, -1, 1)))
        found[axis, angle] = round(float(off), 1)
print(f"seen:      degrees between the frame of fkine and that of the URDF, by axis and angle of the joint [rad]: {found}")
assert all(off < 0.1 for (axis, _), off in found.items() if axis != (0.6, 0, 0.8)), "this has changed"
assert found[(0.6, 0, 0.8), 0.0] > 20 and found[(0.6, 0, 0.8), 1.0] > 20, "this has changed"
PYTHON
