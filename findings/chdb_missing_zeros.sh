#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" chdb==4.4.0 pandas==3.1.1 pyarrow==26.0.1 numpy==2.4.6
echo "guess:     in a left join rows without a partner get NULL, as in SQL"
echo "behaviour: they get 0: positions that no camera saw are the origin, and count in a mean; with join_use_nulls = 1 they are NULL"
python - <<'PYTHON'
import chdb

LOG = "(SELECT number AS time, 1 AS robot FROM numbers(6))"
CAMERA = "(SELECT 2 + 2 * number AS time, 1 AS robot, 5.0 + number AS height FROM numbers(2))"


def asked(kind, condition, settings=""):
    """Heights by time, and their mean, of a log and a camera that saw the times 2 and 4."""
    joined = f"(SELECT log.time AS time, height FROM {LOG} AS log {kind} LEFT JOIN {CAMERA} AS camera ON {condition})"
    queries = (f"SELECT height FROM {joined} ORDER BY time", f"SELECT avg(height) FROM {joined}")
    return [str(chdb.query(f"{query} {settings}", "CSV")).split() for query in queries]


equal, latest = "log.time = camera.time", "log.robot = camera.robot AND log.time >= camera.time"
seen = {"LEFT JOIN": asked("", equal), "ASOF LEFT JOIN": asked("ASOF", latest)}
nulls = asked("", equal, "SETTINGS join_use_nulls = 1")
print(f"seen:      heights at times 0 to 5 and their mean {seen}; with join_use_nulls = 1 {nulls}")
assert seen["LEFT JOIN"][0] == ["0", "0", "5", "0", "6", "0"] and abs(float(seen["LEFT JOIN"][1][0]) - 11 / 6) < 1e-9, "this has changed"
assert seen["ASOF LEFT JOIN"][0] == ["0", "0", "5", "5", "6", "6"] and nulls[1] == ["5.5"], "this has changed"
PYTHON
