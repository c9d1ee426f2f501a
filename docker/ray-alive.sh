#!/usr/bin/env bash
# Whether the Ray head answers; for health checks.
#
#   RAY_HEAD   address of the head (127.0.0.1:6379)
set -euo pipefail

exec ray health-check --address "${RAY_HEAD:-127.0.0.1:6379}"
