#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pyquaternion==0.9.9 numpy==2.4.6
echo "guess:     Quaternion.slerp(a, b, 0.5) leaves a and b as they are"
echo "behaviour: it normalises both in place, and changes the sign of a if b has the other one: filling a gap of a log changes a recorded row"
python - <<'PYTHON'
from pyquaternion import Quaternion

log = [Quaternion(axis=[0, 0, 1], degrees=degrees) for degrees in (150, 160, 170, 190, 200)]
log[3:] = [-row for row in log[3:]]  # as of a tracker that gives w >= 0


def rows():
    return [[round(float(number), 2) for number in row.elements] for row in log]


before = rows()
Quaternion.slerp(log[2], log[3], 0.5)
after = rows()
changed = [index for index, (one, other) in enumerate(zip(before, after)) if one != other]
double = Quaternion(2, 0, 0, 0)
Quaternion.slerp(double, log[0], 0.5)
print(f"seen:      slerp between rows 2 and 3 changed the rows {changed}: {before[2]} became {after[2]}; a norm of 2 became {double.norm}")
assert changed == [2] and after[2] == [-number for number in before[2]] and double.norm == 1, "this has changed"
PYTHON
