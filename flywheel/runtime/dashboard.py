"""MLflow's pages: where the charts of a run are, and how to serve them from its SQLite file."""

from __future__ import annotations

import sys
from pathlib import Path

DATABASE = "mlflow.db"
PORT = 5000
SETTINGS = {  # of MLflow's client and server; what the user has set stays
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0",
    "MLFLOW_LOGGING_LEVEL": "WARNING",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
}


def chart_url(uri: str = "", experiment: str = "1", port: int = PORT) -> str:
    """The charts of an experiment, in the mode for models that learn (MLflow opens in another one).

    Args:
      uri: of a tracking server; anything else means the server that `ui_command` starts.
      experiment: MLflow's id. In a run's own SQLite file it is 1.
      port: of that server.
    """
    base = uri.rstrip("/") if uri.startswith("http") else f"http://127.0.0.1:{port}"
    query = "compareRunsMode=CHART&workflowType=machine_learning"
    return f"{base}/#/experiments/{experiment}/runs?{query}"


def ui_command(folder: str | Path, port: int = PORT) -> tuple[list[str], dict[str, str], str]:
    """How to serve the charts of a run that is tracked in its own folder.

    Returns:
      The command, the environment variables to add, and the URL to open.
    """
    uri = f"sqlite:///{Path(folder).absolute() / DATABASE}"
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", uri]
    command += ["--host", "127.0.0.1", "--port", str(port), "--workers", "1"]
    return command, dict(SETTINGS), chart_url(port=port)
