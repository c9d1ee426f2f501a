#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" deltalake==1.6.6 pyarrow==26.0.1 pandas==3.1.1 numpy==2.4.6
echo "guess:     episodes that were appended to a Delta table one after the other are read in that order, or in none"
echo "behaviour: the last one comes first, always; after an update of one row the episode of that row does"
python - <<'PYTHON'
import numpy as np
import pyarrow as pa
from deltalake import DeltaTable, write_deltalake

for episode in range(4):
    write_deltalake("log", pa.table({"time": 10.0 * episode + np.arange(3.0), "length": np.ones(3)}), mode="append")
table = DeltaTable("log")


def times():
    found = [round(time) for time in table.to_pyarrow_table()["time"].to_pylist()]
    assert found == [round(time) for time in table.to_pandas()["time"]]
    return found


appended = times()
table.update(updates={"length": "2.0"}, predicate="time = 11.0")
updated = times()
print(f"seen:      times as read {appended}; after an update of the row at 11 {updated}")
assert appended == [30, 31, 32, 20, 21, 22, 10, 11, 12, 0, 1, 2] and updated[:3] == [10, 11, 12], "this has changed"
PYTHON
