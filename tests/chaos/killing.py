"""Starting drivers, finding their workers, killing them, and reading off what a run came to."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[2]
# What the thread of a busy worker is called begins with its job's id, of which 15 characters fit.
KINDS = {
    "trainer": r"train-",
    "MPPI worker": r"i\d{4}-mppi-(coll|eval)|oracle-",
    "cell of a table": r"prism3\.nominal\.",
    "sim worker": r"i0000-(gait|random|drop)-|i\d{4}-control|score-|overlay-",
}


def start_driver(
    config: Path, folder: Path, overrides: Sequence[str] = ()
) -> subprocess.Popen[bytes]:
    """Start a driver in a session of its own; its words go to `<folder>.log`."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    environment = {"RAY_AUTH_MODE": "disabled", "RAY_worker_niceness": "0", "PYTHONPATH": str(ROOT)}
    with folder.with_suffix(".log").open("ab") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "tests.chaos.driver", str(config), str(folder), *overrides],
            cwd=ROOT,
            env={**os.environ, **environment},
            stdout=log,
            stderr=log,
            start_new_session=True,
        )


def busy_workers(driver: int) -> dict[int, str]:
    """Workers below a driver that are busy: pid -> kind."""
    found = {}
    try:
        below = psutil.Process(driver).children(recursive=True)
    except psutil.Error:
        return {}
    for process in below:
        for name in _threads(process.pid):
            for kind, pattern in KINDS.items():
                if re.match(pattern, name):
                    found[process.pid] = kind
    return found


def _threads(pid: int) -> list[str]:
    try:
        return [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/comm")]
    except OSError:
        return []


def wait_for(driver: subprocess.Popen[bytes], kind: str, seconds: float) -> int | None:
    """The pid of a busy worker of a kind, as soon as there is one; None if none comes in time."""
    until = time.monotonic() + seconds
    while time.monotonic() < until and driver.poll() is None:
        for pid, what in busy_workers(driver.pid).items():
            if what == kind:
                return pid
        time.sleep(0.1)
    return None


def kill(pid: int) -> bool:
    """kill -9; whether there was such a process."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def outcome(folder: Path) -> dict[str, str]:
    """Everything in a finished run that has to be the same after any interruption."""
    result = json.loads((folder / "result.json").read_text())
    assert result["finished"], f"{folder} is not finished"
    found = {"config": result["config_digest"]}
    for each in result["iterations"]:
        name = f"{each['iteration']}-{each['arm']}"
        found[f"{name} snapshot"] = each["snapshot"]
        found[f"{name} model"] = each["model"]
        found[f"{name} validation"] = json.dumps(each["validation"])
        walks = (each["navigation"] or {}).get("walks")
        found[f"{name} walks"] = json.dumps(walks)
    found["pooled"] = json.dumps(result["pooled"])
    found["floor"] = json.dumps(result["floor"])
    return found
