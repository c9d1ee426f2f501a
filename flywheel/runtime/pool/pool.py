"""A pool of workers that survives their deaths: every job is done once, or reported as set aside.

* Workers start when there is work for them. At most one job per worker, and at most as many threads
  as there are cores, are busy at once.
* A worker that dies, or gives no progress signal for too long, is replaced, and its job is repeated
  by a free worker. Jobs carry their own seeds, so the result is the same.
* A job that kills `DEATHS_ALLOWED` workers is set aside; the others continue.
* If workers do not start, the pool stops with a message instead of waiting for ever.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from flywheel.errors import RunError
from flywheel.runtime.pool.interrupts import Interrupted
from flywheel.runtime.pool.jobs import (
    Answer,
    Backend,
    Beat,
    Group,
    Job,
    PoolReport,
    Quarantined,
    WorkerDied,
)
from flywheel.runtime.pool.progress import Progress, Quiet

DEATHS_ALLOWED = 3
STARTS_ALLOWED = 3


@dataclass(frozen=True)
class Patience:
    """Time limits of the pool, in seconds.

    Attributes:
      start: for a worker to start.
      stall: for a busy worker's next progress signal.
      drain: for running jobs, when the run is asked to stop.
      tick: between two checks of the workers.
    """

    start: float = 120.0
    stall: float = 300.0
    drain: float = 10.0
    tick: float = 0.5


@dataclass(eq=False)
class _Worker:
    group: Group
    handle: Any
    ticket: Any  # of its start, or of its job
    since: float
    ready: bool = False
    job: Job | None = None
    beat: Beat = field(default_factory=Beat)


class WorkerPool:
    """Runs jobs on groups of workers.

    Args:
      backend: starts and queries the workers.
      groups: of workers.
      cores: threads that may compute at the same time.
      patience: time limits.
      stop: returns True when the run is to end.
      clock: gives the time [s]; tests replace it.
    """

    def __init__(
        self,
        backend: Backend,
        groups: Iterable[Group],
        cores: int,
        patience: Patience | None = None,
        stop: Callable[[], bool] = lambda: False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._backend = backend
        self._groups = {group.name: group for group in groups}
        self._cores = max(cores, *(group.threads for group in self._groups.values()))
        self._patience = patience or Patience()
        self._stop = stop
        self._clock = clock
        self._failed_starts: list[str] = []
        self.restarts = 0
        self._workers: list[_Worker] = []

    def share(self, value: Any) -> Any:
        """Put a large argument into shared storage."""
        return self._backend.share(value)

    def run(
        self,
        jobs: Sequence[Job],
        on_result: Callable[[Job, Any], None] = lambda job, result: None,
        progress: Progress | None = None,
        title: str = "jobs",
    ) -> PoolReport:
        """Do every job and return the outcome.

        Args:
          jobs: in order of preference. A later job overtakes one whose workers are all busy, but
            not one whose worker is just starting.
          on_result: called in this process as soon as a job is done.
          progress: display for people.
          title: of the work, for people.

        Raises:
          JobFailed: a job raised an error.
          RunError: the workers do not start, or too many have died.
          Interrupted: the run was asked to stop; finished jobs were reported before.
        """
        if strangers := {job.group for job in jobs} - set(self._groups):
            raise RunError(f"No workers are called {strangers}; there are {sorted(self._groups)}.")
        self._staff(jobs)
        before = self.restarts
        turn = _Turn(deque(jobs), PoolReport(), on_result, frozenset(job.group for job in jobs))
        total = sum(job.size for job in jobs)
        try:
            with (progress or Quiet()).stage(title, total) as shown:
                while turn.queue or self._busy():
                    if self._stop():
                        self._drain(turn)
                        raise Interrupted(f"Stopped during {title!r}; finished work is kept.")
                    self._dispatch(turn)
                    self._collect(turn, self._patience.tick)
                    self._look_after(turn)
                    shown.update(self._done(turn), self._note())
        finally:
            self._abandon()
        turn.report.restarts = self.restarts - before
        return turn.report

    def close(self) -> None:
        """End every worker."""
        for worker in self._workers:
            self._backend.kill(worker.handle)
        self._workers = []

    # --- the four things that `run` does in a loop ------------------------------------------

    def _dispatch(self, turn: _Turn) -> None:
        waiting: deque[Job] = deque()
        starting = Counter(worker.group.name for worker in self._workers if not worker.ready)
        free_cores = self._cores - sum(worker.group.threads for worker in self._busy())
        while turn.queue:
            job = turn.queue.popleft()
            idle = [w for w in self._workers if w.ready and not w.job and w.group.name == job.group]
            if not idle:
                waiting.append(job)
                if starting[job.group]:  # cores are kept for a job whose worker will soon be there
                    starting[job.group] -= 1
                    free_cores -= self._groups[job.group].threads
                continue
            if idle[0].group.threads > free_cores:  # nobody overtakes a job that needs more cores
                waiting.append(job)
                break
            self._send(idle[0], job)
            free_cores -= idle[0].group.threads
        turn.queue.extendleft(reversed(waiting))

    def _collect(self, turn: _Turn, seconds: float) -> None:
        pending = [
            w for w in self._workers if w.job or (not w.ready and w.group.name in turn.groups)
        ]
        finished = set(self._backend.wait([w.ticket for w in pending], seconds))
        for worker in pending:
            if worker.ticket in finished:
                self._finish(worker, turn)

    def _look_after(self, turn: _Turn) -> None:
        now = self._clock()
        for worker in list(self._workers):
            if worker.job is None:
                continue
            beat = self._backend.beat(worker.handle)
            if beat is not None and beat != worker.beat:
                worker.beat, worker.since = beat, now
            elif now - worker.since > self._patience.stall:
                self._backend.kill(worker.handle)
                self._lost(worker, f"no progress for {self._patience.stall:.0f} s", turn)
        self._check_starts(turn, now)

    def _check_starts(self, turn: _Turn, now: float) -> None:
        for name in {job.group for job in turn.queue}:
            own = [w for w in self._workers if w.group.name == name]
            late = now - max((w.since for w in own), default=now) > self._patience.start
            if late and not any(w.ready for w in own):
                raise RunError(
                    f"No {name} worker has started for {self._patience.start:.0f} s; {len(own)} "
                    "requested, 0 running. Has the cluster lost a node, or is it busy? Finished "
                    "work is kept: continue with --resume."
                )

    # --- steps of these ---------------------------------------------------------------------

    def _staff(self, jobs: Sequence[Job]) -> None:
        """Start the workers that these jobs need and that are not running."""
        for group in self._groups.values():
            there = sum(worker.group.name == group.name for worker in self._workers)
            useful = min(group.count, sum(job.group == group.name for job in jobs))
            self._workers += [self._started(group) for _ in range(useful - there)]

    def _started(self, group: Group) -> _Worker:
        handle = self._backend.start(group)
        return _Worker(group, handle, self._backend.ready(handle), self._clock())

    def _busy(self) -> list[_Worker]:
        return [worker for worker in self._workers if worker.job]

    def _send(self, worker: _Worker, job: Job) -> None:
        worker.job, worker.beat, worker.since = job, Beat(), self._clock()
        worker.ticket = self._backend.submit(worker.handle, job)

    def _finish(self, worker: _Worker, turn: _Turn) -> None:
        try:
            answer = self._backend.result(worker.ticket)
        except WorkerDied as death:
            self._lost(worker, str(death), turn)
            return
        job, worker.job, worker.ready = worker.job, None, True
        self._failed_starts.clear()
        if job is not None:
            turn.finished(job, answer)

    def _lost(self, worker: _Worker, why: str, turn: _Turn) -> None:
        self._workers.remove(worker)
        self._backend.kill(worker.handle)
        if not worker.ready:
            self._failed_starts.append(why)
            if len(self._failed_starts) >= STARTS_ALLOWED:
                raise RunError(f"{STARTS_ALLOWED} workers in a row died while starting: {why}")
        if worker.job:
            turn.lost(worker.job, why)
        self.restarts += 1
        self._workers.append(self._started(worker.group))

    def _abandon(self) -> None:
        """Replace workers that are still busy when a call ends early."""
        for worker in self._busy():
            self._workers.remove(worker)
            self._backend.kill(worker.handle)
            self._workers.append(self._started(worker.group))

    def _drain(self, turn: _Turn) -> None:
        until = self._clock() + self._patience.drain
        turn.queue.clear()
        while self._busy() and (left := until - self._clock()) > 0:
            self._collect(turn, min(left, self._patience.tick))
            turn.queue.clear()  # a worker that dies now is not waited for

    def _done(self, turn: _Turn) -> float:
        return turn.done + sum(w.job.size * w.beat.done for w in self._workers if w.job)

    def _note(self) -> str:
        if not any(worker.ready for worker in self._workers):
            return "workers are starting"
        return next((w.beat.note for w in self._workers if w.job and w.beat.note), "")


@dataclass
class _Turn:
    """The state of one call of `run`."""

    queue: deque[Job]
    report: PoolReport
    on_result: Callable[[Job, Any], None]
    groups: frozenset[str]
    deaths: dict[str, list[str]] = field(default_factory=dict)
    done: float = 0.0

    def finished(self, job: Job, answer: Answer) -> None:
        self.report.results[job.id] = answer.value
        self.report.cpu_seconds += answer.cpu_seconds
        self.done += job.size
        self.on_result(job, answer.value)

    def lost(self, job: Job, why: str) -> None:
        deaths = self.deaths.setdefault(job.id, [])
        deaths.append(why)
        if len(deaths) < DEATHS_ALLOWED:
            self.queue.appendleft(job)
            return
        self.done += job.size
        self.report.quarantined.append(Quarantined(job.id, tuple(deaths)))
