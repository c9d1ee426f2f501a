"""Cleans up after a process, however it ends: even a killed one leaves no processes or folders behind.

A `Caretaker` is a small process that runs this file. It waits for the end of a pipe, which the
kernel closes when the process at the other end is gone; then it ends the processes started by that
one. This file imports only the standard library and is run without site packages, so that a
caretaker costs about 20 ms and 9 MB. Hence it is a module of its own.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

MARK = "FLYWHEEL_RAY_FOLDER"  # environment variable that names the folder of a process
GRACE = 5.0  # that processes have to end by themselves [s]
TICK = 0.05  # between two looks at them [s]


class Caretaker:
    """Cleans up when this process, or the `with` block, has ended.

    Args:
      folder: to remove, after its processes (those with `MARK` set to it) have ended.
      group: a process group to end.
    """

    def __init__(self, folder: Path | None = None, group: int | None = None) -> None:
        about = [str(folder)] if folder is not None else ["--group", str(group)]
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", __file__, *about],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C and hangups are not for it
            cwd=os.sep,
        )

    def close(self) -> None:
        """Clean up now, and wait until that is done."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(3 * GRACE)

    def __enter__(self) -> None:
        pass

    def __exit__(self, *error: object) -> None:
        self.close()


def remove(folder: Path, grace: float = GRACE) -> None:
    """End the processes that belong to a folder, then remove it.

    Args:
      folder: to remove.
      grace: time for the processes to end by themselves [s].
    """
    _wait_until(lambda: not any(marked(folder)), grace)
    for process in marked(folder):
        _send(process, signal.SIGKILL)
    _wait_until(lambda: not any(marked(folder)), GRACE)
    shutil.rmtree(folder, ignore_errors=True)


def marked(folder: Path) -> Iterator[int]:
    """The processes of this user that belong to a folder."""
    for entry in Path(os.sep, "proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # of another user, or gone meanwhile
            if _belongs(entry, folder):
                yield int(entry.name)


def _belongs(process: Path, folder: Path) -> bool:
    """True if a process is marked, or is one of Ray's with files there: a title may hide the mark."""
    if f"{MARK}={folder}".encode() in (process / "environ").read_bytes().split(b"\0"):
        return True
    if not (process / "comm").read_text().startswith("ray"):
        return False
    return any(folder in handle.readlink().parents for handle in (process / "fd").iterdir())


def end_group(group: int) -> None:
    """End a process group with SIGTERM, and with SIGKILL if it is still there after `GRACE`."""
    _send(-group, signal.SIGTERM)
    _wait_until(lambda: not _there(-group), GRACE)
    _send(-group, signal.SIGKILL)


def _send(process: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, number)


def _there(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def _wait_until(done: Callable[[], bool], seconds: float) -> None:
    limit = time.monotonic() + seconds
    while not done() and time.monotonic() < limit:
        time.sleep(TICK)


def _main() -> None:
    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(each, signal.SIG_IGN)  # it ends when its work is done
    sys.stdin.buffer.read()
    if sys.argv[1] == "--group":
        end_group(int(sys.argv[2]))
    else:
        remove(Path(sys.argv[1]), grace=GRACE / 5)


if __name__ == "__main__":
    _main()
