#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" "dask[dataframe]==2026.8.0" pandas==3.1.1 numpy==2.4.6
echo "guess:     std of a group is as accurate as std of the whole column, and as pandas'"
echo "behaviour: groups subtract squares of sums: stamps that jitter by 1 ms get 0, or 10 s and more; the whole column is right"
python -W ignore - <<'PYTHON'
import dask.dataframe as dd
import numpy as np
import pandas as pd

random = np.random.default_rng(0)
count = 3000
rows = pd.DataFrame({"robot": np.arange(count) % 3, "stamp": 1.7e9 + random.normal(0, 1e-3, count)})
parts = dd.from_pandas(rows, npartitions=4)
groups, whole = parts.groupby("robot")["stamp"].std().compute(), float(parts["stamp"].std().compute())
right = rows.groupby("robot")["stamp"].std()
print(f"seen:      standard deviations in ms by robot {[float(f'{1e3 * each:.3g}') for each in groups]}, by pandas {[float(f'{1e3 * each:.3g}') for each in right]}; of the whole column {1e3 * whole:.3g}")
assert np.allclose(right, 1e-3, rtol=0.1) and abs(whole - 1e-3) < 1e-4 and not ((groups > 5e-4) & (groups < 2e-3)).any(), "this has changed"
PYTHON
