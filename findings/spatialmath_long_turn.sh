#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" spatialmath-python==1.1.18 pytransform3d==3.17.0 numpy==2.4.6
echo "guess:     between headings of 170 and -170 degrees, interpolated orientations pass 180, however they are written"
echo "behaviour: SE3.interp does; UnitQuaternion.interp of the same library and quaternion_slerp of another go back through 0"
python - <<'PYTHON'
import numpy as np
from pytransform3d.rotations import quaternion_slerp
from spatialmath import SE3, UnitQuaternion

PARTS = (0.25, 0.5, 0.75)


def heading(quaternion):
    """Degrees about z, from 0 to 360."""
    return round(float(np.degrees(2 * np.arctan2(quaternion[3], quaternion[0])) % 360), 3)


first, last = UnitQuaternion.Rz(170, "deg"), UnitQuaternion.Rz(-170, "deg")
poses = [heading(UnitQuaternion(SE3.Rz(170, "deg").interp(SE3.Rz(-170, "deg"), part)).A) for part in PARTS]
quaternions = [heading(first.interp(last, part).A) for part in PARTS]
others = [heading(quaternion_slerp(first.A, last.A, part)) for part in PARTS]
short = [heading(first.interp(last, part, shortest=True).A) for part in PARTS]
print(f"seen:      SE3 {poses}, UnitQuaternion {quaternions}, pytransform3d {others}, UnitQuaternion with shortest=True {short}")
assert poses == short == [175, 180, 185] and quaternions == others == [85, 0, 275], "this has changed"
PYTHON
