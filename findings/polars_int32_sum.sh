#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" polars==2.1.0 numpy==2.4.6
echo "guess:     a sum of int32 counts is right, as numpy's, or an error"
echo "behaviour: beyond 2^31 it wraps, in groups and running sums, too; int16 is widened"
python - <<'PYTHON'
import numpy as np
import polars as pl

counts = np.full(4, 2**30, np.int32)
table = pl.DataFrame({"wheel": ["left"] * 4, "counts": counts})
whole, groups = table["counts"].sum(), table.group_by("wheel").agg(pl.col("counts").sum())["counts"].to_list()
running, mean = table["counts"].cum_sum().to_list(), table["counts"].mean()
small = pl.Series(np.full(4, 2**14, np.int16)).sum()
print(f"seen:      sum {whole}, by group {groups}, running {running}, 4 * mean {4 * mean:.0f}; numpy {counts.sum()}; of int16 {small}")
assert whole == 0 and groups == [0] and running[1] == -(2**31) and 4 * mean == counts.sum() == 2**32 and small == 2**16, "this has changed"
PYTHON
