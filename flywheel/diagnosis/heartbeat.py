"""Signs of life while something computes for long."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")
SECONDS = 5.0  # between two signs


class Interrupted(KeyboardInterrupt):
    """Somebody wants the answer as far as it is known."""


def never() -> bool:
    """Nobody does."""
    return False


class Heartbeat:
    """Hands on what is being done, and says it again while that goes on.

    Args:
      progress: told.
      clock: for tests.
      stop: asked whether that which computes is to end early.
    """

    def __init__(
        self,
        progress: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
        stop: Callable[[], bool] = never,
    ) -> None:
        self._progress, self._clock, self._stop = progress, clock, stop
        self._note, self._last = "beginning", clock()
        self._stopped = False

    def stopped(self) -> bool:
        """Whether `again` has said so: what is left is to be short."""
        return self._stopped

    def in_time(self, compute: Callable[[], T], otherwise: T) -> T:
        """What comes of something that may be left undone; `otherwise` if it is to end early."""
        if self._stopped:
            return otherwise
        try:
            return compute()
        except Interrupted:
            return otherwise

    def insisted(self, compute: Callable[[], T]) -> T:
        """What comes of something that must be done; it begins anew where it was interrupted."""
        try:
            return compute()
        except Interrupted:  # which happens once
            return compute()

    def __call__(self, note: str) -> None:
        """Something else is being done."""
        self._note, self._last = note, self._clock()
        self._progress(note)

    def again(self) -> None:
        """It goes on; to be called often.

        Raises:
          Interrupted: once, if it is to end early.
        """
        if not self._stopped and self._stop():
            self._stopped = True
            self("stopping: the best answer so far follows; Ctrl-C again ends at once")
            raise Interrupted
        if self._clock() - self._last >= SECONDS:
            self(self._note)
