#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" tslearn==0.10.0 numpy==2.4.6
echo "guess:     piecewise aggregates of 109 samples in 10 segments contain all 109, in segments of 10 and 11"
echo "behaviour: segments have 10 samples each, and the last 9 are left out, of PAA and SAX; going back to 109 samples makes them 0"
python -W ignore - <<'PYTHON'
import numpy as np
from tslearn.piecewise import PiecewiseAggregateApproximation, SymbolicAggregateApproximation

steady = np.tile([1.19, 1.21], 55)[None, :109, None]  # a cable's length [m]
slipped = steady.copy()
slipped[0, 100:] = 1.5
aggregates = PiecewiseAggregateApproximation(n_segments=10)
means = aggregates.fit_transform(slipped)
again = aggregates.inverse_transform(means)[0, :, 0]
distance = float(SymbolicAggregateApproximation(n_segments=10, alphabet_size_avg=4).fit(steady).distance(steady[0], slipped[0]))
print(f"seen:      means {np.round(means.ravel(), 3).tolist()}, where the last 9 of 109 samples are 1.5")
print(f"           again {again.size} samples: {np.round(again[97:103], 2).tolist()} from the 98th on; SAX distance to a cable that does not slip {distance}")
assert np.allclose(means, 1.2) and again.size == 109 and np.allclose(again[:100], 1.2) and not again[100:].any() and distance == 0, "this has changed"
PYTHON
