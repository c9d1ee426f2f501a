#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" cma==4.5.0 numpy==2.4.6
echo "guess:     candidates whose cost is NaN, as of a simulation that diverged, rank last"
echo "behaviour: they get the median of the others, also in the caller's own list: they become parents before finite ones"
python - 2>/dev/null <<'PYTHON'
import cma
import numpy as np


def search(bad):
    """The mean after an iteration whose three worst candidates of seven cost `bad`, and the costs."""
    es = cma.CMAEvolutionStrategy([1.0] * 3, 1.0, {"seed": 1, "verbose": -9, "popsize": 7})
    candidates = es.ask()
    costs = [float(np.sum(each**2)) for each in candidates]
    for worst in np.argsort(costs)[-3:]:
        costs[worst] = bad
    given = list(costs)
    es.tell(candidates, costs)
    return es.mean.round(4).tolist(), np.round(given, 3).tolist(), np.round(costs, 3).tolist()


(nan, given, left), (last, *_) = search(np.nan), search(1e9)
print(f"seen:      costs {given} became {left}; mean after it {nan}, with 1e9 instead of NaN {last}")
finite = [cost for cost in given if np.isfinite(cost)]
assert len(finite) == 4 and np.allclose([c for c, g in zip(left, given) if np.isnan(g)], np.median(finite), atol=1e-3), "this has changed"
assert nan != last, "this has changed"
PYTHON
