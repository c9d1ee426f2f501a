"""Signs of life while something computes for long."""

from __future__ import annotations

import time
from collections.abc import Callable

SECONDS = 5.0  # between two signs


class Heartbeat:
    """Hands on what is being done, and says it again while that goes on.

    Args:
      progress: told.
      clock: for tests.
    """

    def __init__(
        self, progress: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._progress, self._clock = progress, clock
        self._note, self._last = "beginning", clock()

    def __call__(self, note: str) -> None:
        """Something else is being done."""
        self._note, self._last = note, self._clock()
        self._progress(note)

    def again(self) -> None:
        """It goes on; to be called often."""
        if self._clock() - self._last >= SECONDS:
            self(self._note)
