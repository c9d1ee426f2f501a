#!/usr/bin/env bash
# Turn the flywheel on a cluster: `driver.sh CONFIG [key=value ...]`. Takes up where it was stopped.
#
#   RAY_HEAD   address of the head (ray-head:6379)
#   RUNS       folder that every worker sees too (./runs)
#   STORE      where trajectory stores are, e.g. s3://flywheel (in the run's folder)
#   MLFLOW_TRACKING_URI   server to publish to (a file in the run's folder)
set -euo pipefail

if [[ $# -lt 1 ]]; then
    echo "usage: driver.sh CONFIG [key=value ...]" >&2
    exit 2
fi
config="$1"
shift
folder="${RUNS:-runs}/$(basename "$config" .yaml)"

# A driver talks to its cluster through a node on its own machine; this one offers no cores.
ray start --address="${RAY_HEAD:-ray-head:6379}" --num-cpus=0 --disable-usage-stats

# Begins a run if there is none, else goes on with it.
options=(--address auto --folder "$folder" --resume)
settings=()
if [[ -n "${STORE:-}" ]]; then
    settings+=("store=$STORE/$(basename "$folder")")
fi
if [[ -n "${MLFLOW_TRACKING_URI:-}" ]]; then
    settings+=("tracking.uri=$MLFLOW_TRACKING_URI")
fi
exec flywheel run "$config" "${options[@]}" "${settings[@]}" "$@"
