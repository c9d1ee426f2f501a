"""Signs of progress from inside a job, for the pool that waits for it."""

from __future__ import annotations

from flywheel.runtime.pool.jobs import Beat


class Watch:
    """Holds a worker's latest sign of progress; another thread reads it."""

    def __init__(self) -> None:
        self.beat = Beat()

    def start(self, note: str = "") -> None:
        """A job begins."""
        self.beat = Beat(note=note, count=self.beat.count + 1)

    def progress(self, done: float, note: str = "") -> None:
        """The share `done` of the job is done."""
        self.beat = Beat(done, self.beat.count + 1, note)
