"""Ctrl-C and SIGTERM: the first asks the run to stop cleanly, the second stops it at once."""

from __future__ import annotations

import math
import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Self

from flywheel.errors import FlywheelError

EXIT_CODE = 130


class Interrupted(FlywheelError):
    """The run stopped because it was asked to; `--resume` goes on from there."""


class StopRequest:
    """Is called to learn whether the user asked to stop. As a context manager it catches the signals.

    In a thread other than the main one no signal can be caught; there `ask` is the only way.

    Args:
      seconds: after which it is as if the user had asked [s]; counted from here.
    """

    SIGNALS = (signal.SIGINT, signal.SIGTERM)

    def __init__(self, seconds: float = math.inf) -> None:
        self._asked, self._end = threading.Event(), time.monotonic() + seconds
        self._before: dict[signal.Signals, object] = {}

    def __call__(self) -> bool:
        if not self._asked.is_set() and time.monotonic() >= self._end:
            self._stop_next()
        return self._asked.is_set()

    def ask(self) -> None:
        """Ask the run to stop as the first Ctrl-C would."""
        self._asked.set()

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._before = {s: signal.signal(s, self._caught) for s in self.SIGNALS}
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._restore()

    def _caught(self, number: int, frame: FrameType | None) -> None:
        self._stop_next()

    def _stop_next(self) -> None:
        """Ask; from now on Python's own handling is back, and a further Ctrl-C stops wherever we are."""
        self.ask()
        for each in self._before:
            signal.signal(each, signal.default_int_handler)

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        self._before = {}
