"""`flywheel ui`: the MLflow dashboard of a run."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from flywheel.errors import DataError
from flywheel.runtime.dashboard import DATABASE, ui_command
from pipelines.show import console


def serve(run: Path, port: int) -> None:
    """Serve until Ctrl-C."""
    if not (run / DATABASE).exists():
        raise DataError(
            f"There is no {DATABASE} in {run}. Is it a run's folder? A run with tracking.uri is "
            "tracked on that server instead."
        )
    command, settings, url = ui_command(run, port)
    console().print(f"Open {url}   (Ctrl-C ends it)", soft_wrap=True)
    subprocess.run(command, env={**os.environ, **settings}, check=False)
