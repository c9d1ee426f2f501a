#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pymoo==0.6.2 numpy==2.4.6
echo "guess:     candidates whose cost is NaN, as of a simulation that diverged, are no results of a search"
echo "behaviour: a particle swarm returns one of them as the best, with the cost NaN; the genetic algorithm and DE do not"
python -W ignore - <<'PYTHON'
import numpy as np
from pymoo.algorithms.soo.nonconvex.de import DE
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.algorithms.soo.nonconvex.pso import PSO
from pymoo.core.problem import ElementwiseProblem
from pymoo.optimize import minimize


class Bowl(ElementwiseProblem):
    """Least, 0, at (0.5, 0.5); beyond 0.8 the cost is `bad`."""

    def __init__(self, bad):
        super().__init__(n_var=2, n_obj=1, xl=-1, xu=1)
        self.bad = bad

    def _evaluate(self, x, out, *args, **kwargs):
        out["F"] = ((x - 0.5) ** 2).sum() if x[0] < 0.8 else self.bad


def best(algorithm, bad):
    result = minimize(Bowl(bad), algorithm(), ("n_gen", 30), seed=1)
    return result.X.round(2).tolist(), round(float(result.F[0]), 4)


seen = {algorithm.__name__: [best(algorithm, bad) for bad in (np.nan, 1e9)] for algorithm in (PSO, GA, DE)}
print(f"seen:      best, and its cost, with NaN and with 1e9: {seen}")
assert np.isnan(seen["PSO"][0][1]) and seen["PSO"][1][1] < 1e-3, "this has changed"
assert all(cost < 1e-3 for name in ("GA", "DE") for _, cost in seen[name]), "this has changed"
PYTHON
