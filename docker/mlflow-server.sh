#!/usr/bin/env bash
# Serve MLflow on a SQLite file, in the foreground.
#
#   MLFLOW_FOLDER          where the data base and the artifacts go (./mlflow)
#   MLFLOW_HOST            address to listen at (127.0.0.1: for this machine alone; 0.0.0.0: for all that
#                          reach it. MLflow has no password)
#   MLFLOW_PORT            port to listen at (5000)
#   MLFLOW_ALLOWED_HOSTS   names that clients may call it by, *with* the port; others get a 403
set -euo pipefail

folder="${MLFLOW_FOLDER:-mlflow}"
port="${MLFLOW_PORT:-5000}"
mkdir -p "$folder/artifacts"
folder="$(cd "$folder" && pwd)"

# No job runner: nothing here uses it, and it costs eight processes.
export MLFLOW_SERVER_ENABLE_JOB_EXECUTION=false
exec mlflow server \
    --host "${MLFLOW_HOST:-127.0.0.1}" \
    --port "$port" \
    --workers 1 \
    --backend-store-uri "sqlite:///$folder/mlflow.db" \
    --artifacts-destination "$folder/artifacts" \
    --allowed-hosts "${MLFLOW_ALLOWED_HOSTS:-mlflow:$port,localhost:$port,127.0.0.1:$port}"
