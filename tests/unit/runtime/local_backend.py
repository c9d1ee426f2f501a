"""Workers inside this process, one after the other: the loop without a cluster."""

from itertools import count
from typing import Any

from flywheel.errors import FlywheelError
from flywheel.runtime.pool.jobs import Answer, Beat, Group, Job, JobFailed


class LocalBackend:
    """Does each job when it is submitted.

    Attributes:
      done: ids of all jobs, in order.
      workers: that were started.
    """

    def __init__(self) -> None:
        self.done: list[str] = []
        self.workers: list[Any] = []
        self._results: dict[int, Any] = {}
        self._numbers = count()

    def start(self, group: Group) -> Any:
        self.workers.append(group.factory(*group.arguments))
        return self.workers[-1]

    def ready(self, worker: Any) -> int:
        return self._ticket(None)

    def submit(self, worker: Any, job: Job) -> int:
        self.done.append(job.id)
        try:
            return self._ticket(getattr(worker, job.method)(*job.arguments))
        except FlywheelError as error:
            return self._ticket(error)
        except Exception as error:
            failed = JobFailed(f"{type(error).__name__}: {error}")
            failed.__cause__ = error
            return self._ticket(failed)

    def wait(self, tickets: list[int], seconds: float) -> list[int]:
        return list(tickets)

    def result(self, ticket: int) -> Answer:
        result = self._results.pop(ticket)
        if isinstance(result, Exception):
            raise result
        return Answer(result)

    def beat(self, worker: Any) -> Beat | None:
        return None

    def kill(self, worker: Any) -> None:
        return None

    def share(self, value: Any) -> Any:
        return value

    def _ticket(self, result: Any) -> int:
        ticket = next(self._numbers)
        self._results[ticket] = result
        return ticket
