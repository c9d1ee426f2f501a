#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" toppra==0.6.10 numpy==2.4.6 scipy==1.17.1
echo "guess:     a trajectory of TOPPRA keeps the limits of acceleration, or comes near to them as the grid gets finer"
echo "behaviour: its default parametrizer is 6 to 12 % above them on any grid; ParametrizeConstAccel keeps them in the same time"
python - <<'PYTHON'
import numpy as np
import toppra
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

toppra.setup_logging("ERROR")
path = toppra.SplineInterpolator(np.linspace(0, 1, 5), np.random.default_rng(0).uniform(-1, 1, (5, 3)))
limits = [JointVelocityConstraint(np.array([[-1.0, 1.0]] * 3)), JointAccelerationConstraint(np.array([[-2.0, 2.0]] * 3))]


def largest(points, **options):
    """Duration [s], and largest acceleration of three joints whose limit is 2 rad/s2."""
    trajectory = TOPPRA(limits, path, gridpoints=np.linspace(0, 1, points), **options).compute_trajectory(0, 0)
    times = np.linspace(0, trajectory.duration, 20001)
    return round(float(trajectory.duration), 2), round(float(abs(trajectory(times, 2)).max()), 3)


grids = (101, 1001, 5001)
spline = [largest(points) for points in grids]
constant = [largest(points, parametrizer="ParametrizeConstAccel") for points in grids]
print(f"seen:      seconds and largest acceleration, limit 2, on grids of {grids}: {spline}; ParametrizeConstAccel {constant}")
assert all(acceleration > 2.1 for _, acceleration in spline), "this has changed"
assert all(acceleration < 2.002 for _, acceleration in constant) and [s[0] for s in spline] == [c[0] for c in constant], "this has changed"
PYTHON
