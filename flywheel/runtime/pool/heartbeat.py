"""Progress signals of a worker from inside a job, for the waiting pool."""

from __future__ import annotations

from flywheel.runtime.pool.jobs import Beat


class Heartbeat:
    """Stores a worker's latest progress signal, which another thread reads."""

    def __init__(self) -> None:
        self.beat = Beat()

    def start(self, note: str = "") -> None:
        """Report the beginning of a job."""
        self.beat = Beat(note=note, count=self.beat.count + 1)

    def progress(self, done: float, note: str = "") -> None:
        """Report the completed fraction `done` (0 to 1) of the job."""
        self.beat = Beat(done, self.beat.count + 1, note)


class Worker:
    """Base of the workers, whose progress the pool asks for."""

    def __init__(self) -> None:
        self._heartbeat = Heartbeat()

    @property
    def beat(self) -> Beat:
        """The latest progress signal."""
        return self._heartbeat.beat
