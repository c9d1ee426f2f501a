"""The charts of a run in MLflow's pages: their URL, and the server for the run's SQLite file."""

from __future__ import annotations

import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from flywheel.errors import ConfigError

DATABASE = "mlflow.db"
HOST = "127.0.0.1"
PORT = 5000
SETTINGS = {  # environment variables of MLflow's client and server; those the user has set stay
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
}


def ui_command(folder: str | Path, port: int = PORT) -> tuple[list[str], dict[str, str], str]:
    """Command that serves the charts of a run tracked in its own folder.

    Returns:
      The command, the environment variables to add, and the URL to open.
    """
    command = [sys.executable, "-m", "mlflow", "server"]
    command += ["--backend-store-uri", database_uri(Path(folder) / DATABASE)]
    command += ["--host", HOST, "--port", str(port), "--workers", "1"]
    quiet = {"MLFLOW_LOGGING_LEVEL": "WARNING", "PYTHONWARNINGS": "ignore"}
    # The charts are of experiment 1, the only one of the file, in MLflow's mode for models that learn.
    charts = "#/experiments/1/runs?compareRunsMode=CHART&workflowType=machine_learning"
    return command, SETTINGS | quiet, f"http://{HOST}:{port}/{charts}"


def database_uri(database: Path) -> str:
    """The URI of an SQLite file, as MLflow takes it.

    Raises:
      ConfigError: its path contains a character with another meaning in a URI.
    """
    path = str(database.absolute())
    if odd := [character for character in "?%" if character in path]:
        raise ConfigError(
            f"MLflow can have no database in {database.parent}: its path contains a {odd[0]!r}. "
            "Use another folder, or track on a server (tracking.uri)."
        )
    return f"sqlite:///{path}"


def damage(database: Path) -> str:
    """The fault of MLflow's SQLite file and its remedy; "" if it is undamaged or missing."""
    if not database.exists():
        return ""
    found = _checked(database) if database.is_file() else "it is no file"
    if not found:
        return ""
    return (
        f"MLflow's database {database} is damaged: {found}. Nothing else is lost: move it away, and the "
        "run's command with --resume makes a new one."
    )


def is_missing(database: Path) -> bool:
    """True if the file is missing, or was left empty by a full disk."""
    return not database.exists() or (database.is_file() and database.stat().st_size == 0)


def _checked(database: Path) -> str:
    """The first finding of SQLite's own check; "" if there is none, or no access at the moment."""
    try:
        address = f"file:{quote(str(database.absolute()))}?mode=ro"
        with closing(sqlite3.connect(address, uri=True)) as connection:
            (found,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.OperationalError:  # e.g. locked
        return ""
    except sqlite3.DatabaseError as error:
        return str(error)
    return "" if found == "ok" else str(found).splitlines()[0]
