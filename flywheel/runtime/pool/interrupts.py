"""Ctrl-C, SIGTERM and the end of the terminal: the first asks a run to stop cleanly, a further one stops it.

A signal that is ignored when the block begins stays ignored: what nohup, or a script's `&`, started goes on.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import FrameType
from typing import Self

from flywheel.errors import FlywheelError

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# Within which signals are one wish: `timeout` sends it to a process and to its group [s].
ONE_WISH = 0.2


class Interrupted(FlywheelError):
    """The run stopped on request; `--resume` continues it."""


@contextmanager
def caught(act: Callable[[], None]) -> Iterator[None]:
    """Call `act` each time that somebody wants this process to end; what it raises is raised where that is.

    The end of the terminal counts once: it may be told several times. In a thread other than the main one no
    signal can be caught.
    """
    last: float | None = None

    def handler(number: int, frame: FrameType | None) -> None:
        nonlocal last
        now, before = time.monotonic(), last
        last = now
        if before is None or (number != signal.SIGHUP and now - before > ONE_WISH):
            act()

    main = threading.current_thread() is threading.main_thread()
    heard = [s for s in SIGNALS if main and signal.getsignal(s) not in (signal.SIG_IGN, None)]
    before = {each: signal.signal(each, handler) for each in heard}
    try:
        yield
    finally:
        for each, was in before.items():
            signal.signal(each, was)


class StopRequest:
    """A callable that returns True once the user asked to stop. As a context manager it catches the
    signals.

    The second wish to end is a KeyboardInterrupt, wherever the process is. In a thread other than the main
    one no signal can be caught; there `ask` is the only way.
    """

    def __init__(self) -> None:
        self._asked, self._caught = threading.Event(), ExitStack()

    def __call__(self) -> bool:
        return self._asked.is_set()

    def ask(self) -> None:
        """Ask the run to stop as the first Ctrl-C would."""
        self._asked.set()

    def __enter__(self) -> Self:
        self._caught.enter_context(caught(self._wished))
        return self

    def __exit__(self, *error: object) -> None:
        self._caught.close()

    def _wished(self) -> None:
        if self._asked.is_set():
            raise KeyboardInterrupt
        self.ask()
