#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" xarray==2026.9.0 zarr==3.1.6 pandas==3.1.1 numpy==2.4.6
echo "guess:     to_zarr(append_dim=...) appends the times that it was given, or refuses them"
echo "behaviour: finer times than those that are there are written in a finer unit, and read in the old one: 5.25 s is 1 h 27 min"
python -W ignore - <<'PYTHON'
import numpy as np
import pandas as pd
import xarray as xr

BEGIN = pd.Timestamp("2026-01-01")


def log(seconds):
    times = BEGIN + pd.to_timedelta(seconds, unit="s")
    return xr.Dataset({"tension": ("time", np.zeros(len(seconds)))}, coords={"time": times})


log([0.0, 1.0, 2.0]).to_zarr("log.zarr")
log([5.0, 5.25, 5.5]).to_zarr("log.zarr", append_dim="time")
seconds = ((xr.open_zarr("log.zarr").time - np.datetime64(BEGIN)) / np.timedelta64(1, "s")).values.tolist()
print(f"seen:      0, 1, 2 and then 5, 5.25, 5.5 s became {seconds}")
assert seconds == [0, 1, 2, 5000, 5250, 5500], "this has changed"
PYTHON
