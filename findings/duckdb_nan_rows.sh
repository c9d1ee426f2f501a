#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" duckdb==2.0.1 pyarrow==26.0.1 pandas==3.1.1 numpy==2.4.6
echo "guess:     where tension > 5 and tension < 100 leaves out rows whose tension is NaN, and gives one answer for one table"
echo "behaviour: NaN is above all numbers, and a limit above all others of a Parquet file is dropped: NaN counts there, not in memory"
python - <<'PYTHON'
import duckdb
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

tensions = np.array([1.0, np.nan, 7.0, np.nan, 3.0])
frame, arrow = pd.DataFrame({"tension": tensions}), pa.table({"tension": tensions})
pq.write_table(arrow, "log.parquet")
SOURCES = {"pandas": "frame", "Arrow": "arrow", "Parquet": "'log.parquet'"}


def counted(where):
    return {name: duckdb.sql(f"select count(*) from {source} where {where}").fetchall()[0][0] for name, source in SOURCES.items()}


above, between = counted("tension > 5"), counted("tension > 5 and tension < 100")
print(f"seen:      of 1, NaN, 7, NaN, 3 N there are {above} above 5 N, {between} from 5 to 100 N")
assert above == {"pandas": 1, "Arrow": 3, "Parquet": 3} and between == {"pandas": 1, "Arrow": 1, "Parquet": 3}, "this has changed"
PYTHON
