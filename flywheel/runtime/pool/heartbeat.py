"""The signs of progress that a worker gives from inside a job, for the pool that waits for it."""

from __future__ import annotations

from flywheel.runtime.pool.jobs import Beat


class Heartbeat:
    """Holds a worker's latest sign of progress, which another thread reads."""

    def __init__(self) -> None:
        self.beat = Beat()

    def start(self, note: str = "") -> None:
        """Say that a job begins."""
        self.beat = Beat(note=note, count=self.beat.count + 1)

    def progress(self, done: float, note: str = "") -> None:
        """Say that the share `done` (0 to 1) of the job is done."""
        self.beat = Beat(done, self.beat.count + 1, note)
