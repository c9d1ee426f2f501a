#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" casadi==3.8.2 numpy==2.4.6
echo "guess:     beyond its table an interpolant goes on as its last piece, or stays at the last value"
echo "behaviour: one of kind 'linear' goes on; one of kind 'bspline' is 0, so a solver sees neither value nor slope"
python - <<'PYTHON'
import casadi
import numpy as np

speeds = np.linspace(0.0, 1.0, 11)
at, x = (0.95, 1.0, 1.01, 1.5, -0.01), casadi.MX.sym("x")
seen = {}
for kind in ("linear", "bspline"):
    drag = casadi.interpolant("drag", kind, [speeds], 5.0 + speeds**2)
    slope = casadi.Function("slope", [x], [casadi.jacobian(drag(x), x)])
    seen[kind] = [(round(float(drag(s)), 3), round(float(slope(s)), 3)) for s in at]
    print(f"seen:      drag and slope at {at}, {kind}: {seen[kind]}")
assert seen["bspline"][1] == (6.0, 2.0), "this has changed"
assert seen["bspline"][2:] == [(0.0, 0.0)] * 3, "this has changed"
assert seen["linear"][2:4] == [(6.019, 1.9), (6.95, 1.9)], "this has changed"
PYTHON
