#!/usr/bin/env bash
# Join a Ray cluster as a worker, in the foreground.
#
#   RAY_HEAD   address of the head (ray-head:6379)
#   RAY_CPUS   cores that it offers (all of them)
set -euo pipefail

options=(--address="${RAY_HEAD:-ray-head:6379}")
if [[ -n "${RAY_CPUS:-}" ]]; then
    options+=(--num-cpus="$RAY_CPUS")
fi
exec ray start --block --disable-usage-stats "${options[@]}"
