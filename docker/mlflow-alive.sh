#!/usr/bin/env bash
# Whether the MLflow server answers; for health checks.
#
#   MLFLOW_PORT   port it listens at (5000)
set -euo pipefail

exec python -c '
import sys, urllib.request
urllib.request.urlopen(f"http://127.0.0.1:{sys.argv[1]}/health", timeout=5)
' "${MLFLOW_PORT:-5000}"
