#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" numpy==2.4.6
echo "guess:     different lists of integers seed different random numbers"
echo "behaviour: zeros at the end do not count (up to four numbers; then they are those of spawned children), and a number"
echo "           of more than 32 bits counts as two"
python - <<'PYTHON'
import numpy as np


def first(seed):
    return round(float(np.random.default_rng(seed).random()), 6)


zeros = {str(seed): first(seed) for seed in (5, [5], [5, 0], [5, 0, 0], [5, 0, 0, 0], [5, 0, 0, 0, 0])}
wide = {"[2**32 + 5, 7]": first([2**32 + 5, 7]), "[5, 1, 7]": first([5, 1, 7])}
spawned = first(np.random.SeedSequence(5).spawn(1)[0])
print(f"seen:      {zeros}")
print(f"           {wide}; the first child of 5, by spawn: {spawned}")
assert len(set(list(zeros.values())[:5])) == 1 and len(set(zeros.values())) == 2, "this has changed"
assert len(set(wide.values())) == 1 and spawned == zeros["[5, 0, 0, 0, 0]"], "this has changed"
PYTHON
