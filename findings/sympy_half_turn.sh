#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" sympy==1.14.0
echo "guess:     Quaternion.from_rotation_matrix of any rotation is that rotation"
echo "behaviour: a half turn about any axis is the zero quaternion, which turns back into NaN; a third of a turn is right"
python - <<'PYTHON'
from sympy import Matrix, Quaternion, Rational

TURNS = {
    "half, x": Matrix([[1, 0, 0], [0, -1, 0], [0, 0, -1]]),
    "half, x - y": Matrix([[0, -1, 0], [-1, 0, 0], [0, 0, -1]]),
    "half, x + y + z": Matrix([[-1, 2, 2], [2, -1, 2], [2, 2, -1]]) * Rational(1, 3),
    "third, x + y + z": Matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
}
found = {}
for axis, turn in TURNS.items():
    assert turn * turn.T == Matrix.eye(3) and turn.det() == 1
    found[axis] = Quaternion.from_rotation_matrix(turn)
again = found["half, x"].to_rotation_matrix()
print(f"seen:      {({axis: str(quaternion) for axis, quaternion in found.items()})}")
print(f"           the first as a matrix again {again.tolist()}")
*halves, third = found.values()
assert third.args[:4] == (Rational(1, 2),) * 4 and all(quaternion.norm() == 0 for quaternion in halves), "this has changed"
PYTHON
