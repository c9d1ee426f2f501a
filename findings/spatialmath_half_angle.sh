#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" spatialmath-python==1.1.18 numpy==2.4.6 scipy==1.17.1
echo "guess:     angdist of two orientations, in radians, is the angle of the rotation between them, as matrices or as unit quaternions"
echo "behaviour: of UnitQuaternion it is half of it, of SO3 all of it: the same method, with another default of metric"
python - <<'PYTHON'
import numpy as np
from spatialmath import SO3, UnitQuaternion

seen = {}
for degrees in (1, 30, 90, 180):
    quaternions = UnitQuaternion.Rz(20, "deg").angdist(UnitQuaternion.Rz(20 + degrees, "deg"))
    matrices = SO3.Rz(20, "deg").angdist(SO3.Rz(20 + degrees, "deg"))
    seen[degrees] = [round(float(np.degrees(angle)), 3) for angle in (quaternions, matrices)]
print(f"seen:      angdist of UnitQuaternion and of SO3, by the angle, all in degrees: {seen}")
assert all(abs(half - degrees / 2) < 1e-3 and abs(whole - degrees) < 1e-3 for degrees, (half, whole) in seen.items()), "this has changed"
PYTHON
