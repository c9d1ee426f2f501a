#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" polars==2.1.0 numpy==2.4.6
echo "guess:     rolling_corr lies between -1 and 1, and does not depend on the origin, as rolling_std and corr"
echo "behaviour: it is a difference of means of products: 5300 km from the origin, as northings are, it is anything between -100 and 100"
python - <<'PYTHON'
import numpy as np
import polars as pl

random = np.random.default_rng(0)
true = np.cumsum(random.normal(0, 0.01, 2000))  # m
seen = true + random.normal(0, 0.005, 2000)
exact = np.array([np.corrcoef(true[end - 50 : end], seen[end - 50 : end])[0, 1] for end in range(50, 2001)])
found = {}
for origin in (0.0, 1e5, 5.3e6):  # m
    frame = pl.DataFrame({"true": true + origin, "seen": seen + origin})
    rolling = frame.select(pl.rolling_corr("true", "seen", window_size=50)).to_series().to_numpy()[49:]
    whole = frame.select(pl.corr("true", "seen")).item()
    found[origin] = [round(float(each), 3) for each in (np.nanmin(rolling), np.nanmax(rolling), np.nanmax(np.abs(rolling - exact)), whole)]
print(f"seen:      least and largest rolling_corr, its largest error, and corr of all rows, by distance from the origin [m]: {found}")
assert found[0.0][2] < 1e-3 and found[1e5][2] > 0.005 and found[5.3e6][1] > 2 and found[5.3e6][0] < -2, "this has changed"
assert all(abs(each[3] - found[0.0][3]) < 1e-3 for each in found.values()), "this has changed"
PYTHON
