"""The jobs of a worker pool and their answers, independent of Ray."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from flywheel.errors import FlywheelError


class WorkerDied(FlywheelError):
    """The worker was gone before it could answer; the job may be repeated."""


class JobFailed(FlywheelError):
    """A job raised an error, and would raise it again.

    Attributes:
      trace: the worker's traceback, as text.
    """

    def __init__(self, message: str, trace: str = "") -> None:
        super().__init__(message)
        self.trace = trace


@dataclass(frozen=True)
class Group:
    """Workers of one kind.

    Attributes:
      name: requested by jobs, e.g. "sim" or "trainer".
      factory: makes the worker inside its process.
      arguments: of the factory.
      count: number of workers.
      cpus: booked by each worker from the cluster; 0 if groups take turns on the same cores.
      gpus: booked by each worker.
      threads: of each worker and its helpers; a running job takes as many of the pool's cores.
    """

    name: str
    factory: type
    arguments: tuple[Any, ...] = ()
    count: int = 1
    cpus: float = 1.0
    gpus: float = 0.0
    threads: int = 1


@dataclass(frozen=True)
class Job:
    """One piece of work. It can be repeated with the same result if its worker dies.

    Attributes:
      id: unique within the run; the same work has the same id in a resumed run.
      group: name of the workers that can do it.
      method: name of the worker's method.
      arguments: of the method; large ones are shared beforehand (`WorkerPool.share`).
      size: expected amount of work, for progress, in any unit that all jobs of one call share.
    """

    id: str
    group: str
    method: str
    arguments: tuple[Any, ...] = ()
    size: float = 1.0


@dataclass(frozen=True)
class Beat:
    """A progress signal of a busy worker.

    Attributes:
      done: completed fraction of the job, 0 to 1.
      count: grows with every signal, also if the fraction does not.
      note: for people ("step 400, loss 0.12").
    """

    done: float = 0.0
    count: int = 0
    note: str = ""


@dataclass(frozen=True)
class Answer:
    """The answer of a worker to a job.

    Attributes:
      value: return value of the job's method.
      cpu_seconds: used by the worker and its helpers for it, in all threads [s].
    """

    value: Any = None
    cpu_seconds: float = 0.0


@dataclass(frozen=True)
class Quarantined:
    """A job set aside because it killed several workers."""

    id: str
    deaths: tuple[str, ...]


@dataclass
class PoolReport:
    """The outcome of one call of `WorkerPool.run`.

    Attributes:
      results: by job id.
      quarantined: jobs without a result.
      restarts: workers started in place of one that died or hung.
      cpu_seconds: used for the jobs that have results [s].
    """

    results: dict[str, Any] = field(default_factory=dict)
    quarantined: list[Quarantined] = field(default_factory=list)
    restarts: int = 0
    cpu_seconds: float = 0.0


class Backend(Protocol):
    """Starts, queries and ends workers: `ray_backend.RayBackend`, or a fake in tests."""

    def start(self, group: Group) -> Any:
        """Start a worker and return its handle, without waiting."""
        ...

    def ready(self, worker: Any) -> Hashable:
        """A ticket that is finished when the worker has started."""
        ...

    def submit(self, worker: Any, job: Job) -> Hashable:
        """Send the job to the worker and return a ticket, without waiting."""
        ...

    def wait(self, tickets: Sequence[Any], seconds: float) -> list[Any]:
        """The finished tickets, as soon as there is one or `seconds` have passed."""
        ...

    def result(self, ticket: Any) -> Answer:
        """The answer of a finished ticket; an empty one for the start of a worker.

        Raises:
          WorkerDied: the worker is gone.
          JobFailed: the job raised an error.
        """
        ...

    def beat(self, worker: Any) -> Beat | None:
        """The worker's last known progress signal, without waiting; None if none is known."""
        ...

    def kill(self, worker: Any) -> None:
        """End the worker at once."""
        ...

    def share(self, value: Any) -> Any:
        """Put a large value into shared storage; pass the result as an argument."""
        ...
