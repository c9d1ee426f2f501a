"""What the pool is asked to do, and what came of it. Nothing here knows about Ray."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from flywheel.errors import FlywheelError


class WorkerDied(FlywheelError):
    """The worker went away before it could answer. The job itself is not to blame (yet)."""


class JobFailed(FlywheelError):
    """A job raised an error of its own; doing it again would raise it again.

    Attributes:
      trace: where, as text from the worker.
    """

    def __init__(self, message: str, trace: str = "") -> None:
        super().__init__(message)
        self.trace = trace


@dataclass(frozen=True)
class Group:
    """Workers of one kind.

    Attributes:
      name: that jobs ask for ("sim", "trainer").
      factory: makes the worker inside its process.
      arguments: of the factory.
      count: how many of them.
      cpus: that each books from the cluster; 0 where groups take turns on the same cores.
      gpus: that each books.
      threads: that each may compute with; a running job takes as many of the pool's cores.
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
    """One piece of work that may be done again, with the same result, should its worker die.

    Attributes:
      id: unique within the run; the same work has the same id in a resumed run.
      group: which workers can do it.
      method: of the worker.
      arguments: of the method; large ones shared beforehand (`WorkerPool.share`).
      size: expected amount of work, for progress (any unit, the same for all jobs of one call).
    """

    id: str
    group: str
    method: str
    arguments: tuple[Any, ...] = ()
    size: float = 1.0


@dataclass(frozen=True)
class Beat:
    """A sign of progress of a worker that is busy with a job.

    Attributes:
      done: share of the job that is done, 0 to 1.
      count: grows with every sign of progress, also where the share does not.
      note: for people ("step 400, loss 0.12").
    """

    done: float = 0.0
    count: int = 0
    note: str = ""


@dataclass(frozen=True)
class Answer:
    """What a worker gives back.

    Attributes:
      value: that the job's method returned.
      cpu_seconds: that the worker's process spent on it, in all threads [s].
    """

    value: Any = None
    cpu_seconds: float = 0.0


@dataclass(frozen=True)
class Quarantined:
    """A job set aside because it took several workers down with it."""

    id: str
    deaths: tuple[str, ...]


@dataclass
class PoolReport:
    """What one call of `WorkerPool.run` did.

    Attributes:
      results: by job id.
      quarantined: jobs without a result.
      restarts: workers started in place of one that died or hung.
      cpu_seconds: spent on the jobs that have results [s].
    """

    results: dict[str, Any] = field(default_factory=dict)
    quarantined: list[Quarantined] = field(default_factory=list)
    restarts: int = 0
    cpu_seconds: float = 0.0


class Backend(Protocol):
    """Where workers live. `cluster.RayBackend` in earnest, a plain fake in tests."""

    def start(self, group: Group) -> Any:
        """Begin to start a worker and return its handle, without waiting."""
        ...

    def ready(self, worker: Any) -> Hashable:
        """A ticket that is finished once the worker has started."""
        ...

    def submit(self, worker: Any, job: Job) -> Hashable:
        """Send the job to the worker and return a ticket, without waiting."""
        ...

    def wait(self, tickets: Sequence[Any], seconds: float) -> list[Any]:
        """Those tickets that are finished, as soon as there is one or `seconds` are over."""
        ...

    def result(self, ticket: Any) -> Answer:
        """The answer of a finished ticket; an empty one where a worker has started.

        Raises:
          WorkerDied: the worker is gone.
          JobFailed: the job raised an error.
        """
        ...

    def beat(self, worker: Any) -> Beat | None:
        """The worker's last known sign of progress, without waiting; None if none is known."""
        ...

    def kill(self, worker: Any) -> None:
        """End the worker at once."""
        ...

    def share(self, value: Any) -> Any:
        """Put a large value where every worker can read it; pass the result as an argument."""
        ...
