#!/usr/bin/env bash
# Turn the flywheel on a cluster: `driver.sh CONFIG [key=value ...]`. Takes up where it was stopped.
#
#   RAY_HEAD   address of the head (ray-head:6379)
#   RUNS       folder that every worker sees too (./runs)
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

options=(--address auto --folder "$folder")
if [[ -e "$folder" ]]; then
    options+=(--resume)
fi
exec flywheel run "$config" "${options[@]}" "$@"
