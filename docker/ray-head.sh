#!/usr/bin/env bash
# Start the Ray head, in the foreground. It coordinates and works too.
#
#   RAY_PORT   port that workers and drivers join at (6379)
#   RAY_CPUS   cores that it offers (all of them)
#
# It listens to the network, for workers on other machines. Ray has no password, and whoever reaches its
# ports can run programs: keep them inside a network you trust.
set -euo pipefail

options=(--port="${RAY_PORT:-6379}")
if [[ -n "${RAY_CPUS:-}" ]]; then
    options+=(--num-cpus="$RAY_CPUS")
fi
exec ray start --head --block --include-dashboard=false --disable-usage-stats "${options[@]}"
