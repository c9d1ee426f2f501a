#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mlflow==3.17.2
echo "guess:     an infinite metric comes back infinite, or is refused"
echo "behaviour: a database keeps the largest finite number in its place, so isfinite() is true of a loss that diverged"
export MLFLOW_DISABLE_TELEMETRY=true
python - 2> mlflow.log <<'PYTHON'
import math

from mlflow import MlflowClient

client = MlflowClient("sqlite:///mlflow.db")
run = client.create_run(client.create_experiment("e")).info.run_id
client.log_metric(run, "loss", math.inf)
client.log_metric(run, "nothing", math.nan)
found = client.get_run(run).data.metrics

print(f"seen:      inf came back as {found['loss']!r}, nan as {found['nothing']!r}")
assert math.isfinite(found["loss"]) and math.isnan(found["nothing"]), "this has changed"
PYTHON
