#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" highspy==1.16.0 numpy==2.4.6
echo "guess:     HiGHS solves a quadratic program to its tolerances, 1e-7, in millimetres and in metres"
echo "behaviour: unknowns that no constraint holds are 0 where their optimum is below 1e-4, as Optimal, whatever the tolerances: in metres a step of 0.1 mm is none"
python - <<'PYTHON'
import highspy
import numpy as np

jacobian = np.random.default_rng(0).normal(size=(3, 6))  # m per radian of six joints
matrix = jacobian.T @ jacobian + 1e-3 * np.eye(6)


def step(distance, tolerance):
    """The status, and the error of HiGHS' step [share of the exact one], towards a target [m]."""
    slope = -jacobian.T @ (distance * np.array([0.6, -0.3, 0.7]))
    solver, model = highspy.Highs(), highspy.HighsModel()
    solver.setOptionValue("output_flag", False)
    for option in ("primal_feasibility_tolerance", "dual_feasibility_tolerance", "optimality_tolerance", "kkt_tolerance"):
        solver.setOptionValue(option, tolerance)
    model.lp_.num_col_, model.lp_.num_row_, model.lp_.col_cost_ = 6, 0, slope
    model.lp_.col_lower_, model.lp_.col_upper_ = np.full(6, -10.0), np.full(6, 10.0)
    model.lp_.row_lower_ = model.lp_.row_upper_ = np.array([])
    rows = [(row, column) for column in range(6) for row in range(column, 6)]
    model.hessian_.dim_, model.hessian_.format_ = 6, highspy.HessianFormat.kTriangular
    model.hessian_.start_ = np.cumsum([0, 6, 5, 4, 3, 2, 1])
    model.hessian_.index_, model.hessian_.value_ = np.array([row for row, _ in rows]), np.array([matrix[at] for at in rows])
    solver.passModel(model)
    solver.run()
    exact = np.linalg.solve(matrix, -slope)
    error = np.linalg.norm(np.array(solver.getSolution().col_value) - exact) / np.linalg.norm(exact)
    return solver.modelStatusToString(solver.getModelStatus()), round(float(error), 3)


found = {(distance, tolerance): step(distance, tolerance) for tolerance in (1e-7, 1e-10) for distance in (1e-2, 1e-3, 1e-4)}
print(f"seen:      by distance to the target [m] and tolerance: status, and error as a share of the step: {found}")
for tolerance in (1e-7, 1e-10):
    assert all(found[distance, tolerance][0] == "Optimal" for distance in (1e-2, 1e-3, 1e-4)), "this has changed"
    assert found[1e-2, tolerance][1] == 0 and 0.03 < found[1e-3, tolerance][1] < 0.5, "this has changed"
    assert found[1e-4, tolerance][1] == 1, "this has changed"
PYTHON
