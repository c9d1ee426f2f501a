#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" crocoddyl==3.2.1 pin==4.1.0 numpy==2.3.5
echo "guess:     a problem whose models have u_lb and u_ub, and so has_control_limits, is solved within them by SolverFDDP, or refused"
echo "behaviour: it is solved without them, as a success: the commands reach 2.5 where 2 is the most; SolverBoxFDDP keeps to them"
python - <<'PYTHON'
import crocoddyl
import numpy as np

STEP = 0.1  # s


class Cart(crocoddyl.ActionModelAbstract):
    """A cart of 1 kg that is to stand at 1 m at the end."""

    def __init__(self, last):
        crocoddyl.ActionModelAbstract.__init__(self, crocoddyl.StateVector(2), 1, 1)
        self.last = last

    def calc(self, data, x, u=None):
        u = np.zeros(1) if u is None else u
        data.xnext = np.array([x[0] + STEP * x[1], x[1] + STEP * u[0]])
        data.cost = 500 * ((x[0] - 1) ** 2 + x[1] ** 2) if self.last else 0.005 * u[0] ** 2

    def calcDiff(self, data, x, u=None):
        data.Fx, data.Fu = np.array([[1.0, STEP], [0.0, 1.0]]), np.array([[0.0], [STEP]])
        if self.last:
            data.Lx, data.Lxx = 1000 * np.array([x[0] - 1, x[1]]), 1000 * np.eye(2)
        else:
            data.Lu, data.Luu = 0.01 * np.asarray(u), np.array([[0.01]])


between, end = Cart(last=False), Cart(last=True)
between.u_lb, between.u_ub = np.array([-2.0]), np.array([2.0])
seen = {}
for name in ("SolverDDP", "SolverFDDP", "SolverBoxDDP", "SolverBoxFDDP"):
    solver = getattr(crocoddyl, name)(crocoddyl.ShootingProblem(np.zeros(2), [between] * 15, end))
    solved = solver.solve([], [], 100)
    seen[name] = solved, round(float(np.abs(np.array(solver.us)).max()), 3)
print(f"seen:      has_control_limits {between.has_control_limits}; solved, and largest command [N], where 2 is the limit: {seen}")
assert between.has_control_limits and all(solved for solved, _ in seen.values()), "this has changed"
assert min(seen["SolverDDP"][1], seen["SolverFDDP"][1]) > 2.4 and max(seen["SolverBoxDDP"][1], seen["SolverBoxFDDP"][1]) < 2.001, "this has changed"
PYTHON
