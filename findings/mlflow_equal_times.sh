#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mlflow==3.17.2
echo "guess:     a run shows the value of a metric that was logged last"
echo "behaviour: it shows that of the highest step, of these the latest stamp, and of equal stamps the largest number"
export MLFLOW_DISABLE_TELEMETRY=true DO_NOT_TRACK=true
python - 2> mlflow.log <<'PYTHON'
from mlflow import MlflowClient

client = MlflowClient("sqlite:///mlflow.db")
run = client.create_run(client.create_experiment("try")).info.run_id
for value, step in ((5.0, 80), (3.0, 50), (4.0, 51)):  # as a run does that goes on from a checkpoint at 50
    client.log_metric(run, "resumed", value, step=step)
for value in (2.0, 7.0, 1.0):  # within a millisecond, or with a stamp of the caller's own
    client.log_metric(run, "repeated", value, step=3, timestamp=1000)
shown = client.get_run(run).data.metrics
print(f"seen:      5 at step 80, then 3 at 50 and 4 at 51, shows {shown['resumed']}; 2, 7 and 1 at one step and stamp show {shown['repeated']}")
assert (shown["resumed"], shown["repeated"]) == (5.0, 7.0), "this has changed"
PYTHON
