#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" ruptures==1.1.10 numpy==2.4.6 scipy==1.17.1
echo "guess:     Pelt and Dynp, which are exact, find the sample at which a signal without noise jumps"
echo "behaviour: they name multiples of 5 only, up to 4 samples off; with jump=1, and in KernelCPD, they are exact"
python - <<'PYTHON'
import numpy as np
import ruptures

jumps = [103, 191, 257]
signal = np.repeat([0.0, 1.0, 0.0, 2.0], np.diff([0, *jumps, 300]))
seen = {
    "Pelt": ruptures.Pelt("l2").fit(signal).predict(pen=1),
    "Dynp": ruptures.Dynp("l2").fit(signal).predict(3),
    "Binseg": ruptures.Binseg("l2").fit(signal).predict(3),
    "Pelt(jump=1)": ruptures.Pelt("l2", jump=1).fit(signal).predict(pen=1),
    "KernelCPD": ruptures.KernelCPD("linear").fit(signal).predict(3),
}
print(f"seen:      the signal jumps at {jumps}: { {name: [int(place) for place in places[:-1]] for name, places in seen.items()} }")
for name, places in seen.items():
    exact = name in ("Pelt(jump=1)", "KernelCPD")
    assert (places[:-1] == jumps) == exact and (exact or all(place % 5 == 0 for place in places[:-1])), "this has changed"
PYTHON
