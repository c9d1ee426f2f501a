#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" numba==0.68.1 llvmlite==0.50.0 numpy==2.4.6
echo "guess:     a compiled sum or mean of an array is as accurate as numpy's"
echo "behaviour: it adds one after the other, numpy in pairs: the mean of ten million equal float32 numbers is 9 % off"
cat > try.py <<'PYTHON'
import numpy as np
from numba import njit

total, mean = njit(lambda values: values.sum()), njit(lambda values: np.mean(values))
off = {}
for count in (10_000, 1_000_000, 10_000_000):
    values = np.full(count, 0.1, np.float32)
    truth = count * float(np.float32(0.1))
    off[count] = (float(total(values)) / truth - 1, float(mean(values)) * count / truth - 1, float(values.sum()) / truth - 1)
    print(f"seen:      {count:>10,} numbers: compiled sum {off[count][0]:+.1e}, mean {off[count][1]:+.1e}, numpy's {off[count][2]:+.1e}")
assert 0.08 < off[10_000_000][0] < 0.1 and 0.08 < off[10_000_000][1] < 0.1, "this has changed"
assert off[1_000_000][0] > 1e-3 and max(abs(each[2]) for each in off.values()) < 1e-6, "this has changed"
PYTHON
python try.py
