#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" modern_robotics==1.1.1 numpy==2.4.6
echo "guess:     a body that turns at 0.05 deg/s has turned by 3 deg after a minute of steps of a millisecond"
echo "behaviour: it has not turned at all: MatrixExp3 and MatrixExp6 of less than a microradian are no rotation; 0.06 deg/s is right"
python - <<'PYTHON'
import math

import modern_robotics
import numpy as np

STEP, STEPS = 0.001, 60_000


def turned(rate):
    """Angle [deg] about z after a minute at `rate` [deg/s], by rotations and by poses."""
    turn = modern_robotics.MatrixExp3(modern_robotics.VecToso3(np.array([0, 0, math.radians(rate) * STEP])))
    move = modern_robotics.MatrixExp6(modern_robotics.VecTose3(np.array([0, 0, math.radians(rate) * STEP, 0.1 * STEP, 0, 0])))
    rotation, pose = np.eye(3), np.eye(4)
    for _ in range(STEPS):
        rotation, pose = rotation @ turn, pose @ move
    return [round(math.degrees(math.atan2(each[1, 0], each[0, 0])), 4) for each in (rotation, pose)]


angles = {rate: turned(rate) for rate in (0.05, 0.06)}
print(f"seen:      degrees after 60 s by deg/s: {angles}; expected 3.0 and 3.6")
assert angles[0.05] == [0, 0] and angles[0.06] == [3.6, 3.6], "this has changed"
PYTHON
