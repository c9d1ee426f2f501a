#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" netCDF4==1.7.5.1.post1 h5py==3.16.0 numpy==2.4.6
echo "guess:     variables of a netCDF 4 file along one dimension have equally many rows, read as HDF5, too"
echo "behaviour: each has only the rows up to its last one that was written; rows before it that were skipped are 1e37"
python - <<'PYTHON'
import h5py
import netCDF4
import numpy as np

with netCDF4.Dataset("log.nc", "w") as file:
    file.createDimension("time", None)
    for name, rows in (("time", range(5)), ("height", (0, 2)), ("tension", ())):
        variable = file.createVariable(name, "f8", ("time",))
        for row in rows:
            variable[row] = 1.5
with netCDF4.Dataset("log.nc") as file:
    library = {name: np.ma.filled(each[:], np.nan).tolist() for name, each in file.variables.items()}
with h5py.File("log.nc") as file:
    plain = {name: each[:].tolist() for name, each in file.items()}
print(f"seen:      by netCDF4 {library}")
print(f"           by h5py    {plain}")
assert [len(each) for each in library.values()] == [5, 5, 5], "this has changed"
assert {name: len(each) for name, each in plain.items()} == {"time": 5, "height": 3, "tension": 0}, "this has changed"
assert plain["height"][1] > 9e36, "this has changed"
PYTHON
