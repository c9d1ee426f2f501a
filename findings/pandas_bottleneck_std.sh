#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pandas==3.1.1 bottleneck==1.6.0 numpy==2.4.6
echo "guess:     which packages are installed does not change the standard deviation of a pandas Series"
echo "behaviour: with bottleneck, pandas uses it: a float32 column of ten million numbers, 1000 +- 1, has one of 22.6; the mean is right"
python - <<'PYTHON'
import sys

import numpy as np
import pandas as pd

column = pd.Series(np.random.default_rng(0).normal(1000, 1, 10_000_000).astype("float32"))


def numbers(values):
    return [round(float(number), 3) for number in (values.mean(), values.std(), values.var(), values.sem() * 1e3)]


used = numbers(column)
with pd.option_context("compute.use_bottleneck", False):
    without = numbers(column)
minutes = {rows: round(float(column[:rows].std()), 3) for rows in (60_000, 600_000, 6_000_000)}
print(f"seen:      mean, deviation, variance, 1000 x error of the mean: {used}; without bottleneck {without}; deviation by rows {minutes}")
assert "bottleneck" in sys.modules and used[0] == without[0], "this has changed"
assert used[1] > 20 and abs(without[1] - 1) < 0.01, "this has changed"
PYTHON
