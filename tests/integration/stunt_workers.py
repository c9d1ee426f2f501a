"""Workers that do little but can be asked to misbehave, and ways to find their processes."""

import contextlib
import os
import signal
import sys
import time
from pathlib import Path

import cloudpickle
import numpy as np
import psutil

from flywheel.runtime.pool.jobs import Beat


def by_value() -> None:
    """Send this module's classes to workers as they are; workers cannot import tests."""
    cloudpickle.register_pickle_by_value(sys.modules[__name__])


class Stunt:
    """A worker.

    Args:
      folder: where attempts at a job leave a trace.
    """

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder)
        self.beat = Beat()

    def draw(self, seed: int, seconds: float = 0.0) -> tuple[float, int]:
        """A random number that depends on the seed alone, and who drew it."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            time.sleep(0.05)
            self.beat = Beat(count=self.beat.count + 1)
        return float(np.random.default_rng(seed).normal()), os.getpid()

    def die(self, name: str, times: int) -> int:
        """Die at the first `times` attempts; then tell how many there were."""
        attempt = self._attempt(name)
        if attempt < times:
            os.kill(os.getpid(), signal.SIGKILL)
        return attempt

    def stop(self, name: str) -> int:
        """Freeze, heartbeat included, at the first attempt."""
        attempt = self._attempt(name)
        if attempt == 0:
            os.kill(os.getpid(), signal.SIGSTOP)
            time.sleep(1000)  # this thread may run on for a moment
        return attempt

    def sleep(self, name: str) -> int:
        """Hang, while the process itself still answers, at the first attempt."""
        attempt = self._attempt(name)
        if attempt == 0:
            time.sleep(1000)
        return attempt

    def fail(self) -> None:
        """Raise."""
        raise ValueError("a mistake in the job")

    def threads(self) -> tuple[str, int]:
        """What this process believes about threads."""
        import torch

        return os.environ["OMP_NUM_THREADS"], torch.get_num_threads()

    def total(self, array: np.ndarray) -> tuple[float, bool]:
        """Sum of a shared array, and whether it could be written to."""
        return float(array.sum()), bool(array.flags.writeable)

    def _attempt(self, name: str) -> int:
        attempts = len(list(self._folder.glob(f"{name}.*")))
        (self._folder / f"{name}.{attempts}").touch()
        return attempts


def at_work(on: str) -> list[tuple[psutil.Process, str]]:
    """Worker processes below this one with a thread that works on a job so named, and which."""
    found = []
    for process in psutil.Process(os.getpid()).children(recursive=True):
        with contextlib.suppress(OSError):
            names = [p.read_text() for p in Path(f"/proc/{process.pid}/task").glob("*/comm")]
            found += [(process, name.strip()) for name in names if name.startswith(on)]
    return found
