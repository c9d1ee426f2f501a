"""Lock files: at most one driver per run folder, and one trainer per model folder."""

from __future__ import annotations

import fcntl
import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flywheel.errors import ConfigError


@contextmanager
def hold(path: Path, what: str, wait_seconds: float = 0.0) -> Iterator[None]:
    """Hold the lock file `path` for as long as the block runs.

    The kernel releases the lock when its process ends, however it ends, so no lock is stale. It
    works between the processes of one machine, and over NFS v4.

    Args:
      path: of the lock file; made if it is missing, and kept afterwards.
      what: name of the guarded thing, for the message, e.g. "The run in runs/a".
      wait_seconds: longest wait for another holder [s].

    Raises:
      ConfigError: another process holds it; the message names its pid and host.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        if not _taken(handle, wait_seconds):
            raise ConfigError(f"{what} is in use by {_holder(path)}. Wait for it, or stop it.")
        os.ftruncate(handle, 0)
        os.pwrite(handle, _signature(), 0)
        yield
    finally:
        os.close(handle)


def _taken(handle: int, wait_seconds: float) -> bool:
    until = time.monotonic() + wait_seconds
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            if time.monotonic() >= until:
                return False
            time.sleep(0.1)


def _signature() -> bytes:
    mine = {"pid": os.getpid(), "host": socket.gethostname(), "since": time.strftime("%F %T")}
    return json.dumps(mine).encode()


def _holder(path: Path) -> str:
    try:
        other = json.loads(path.read_text())
        return f"process {other['pid']} on {other['host']} since {other['since']}"
    except (ValueError, KeyError, OSError):
        return "another process"
