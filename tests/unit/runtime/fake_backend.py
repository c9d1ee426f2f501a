"""A backend without processes: what each attempt at a job does is written down beforehand."""

from dataclasses import dataclass, field
from itertools import count
from typing import Any

from flywheel.runtime.pool.jobs import Answer, Beat, Group, Job, JobFailed, WorkerDied

DIE, HANG, CRASH, SLOW = "die", "hang", "crash", "slow"


@dataclass
class FakeBackend:
    """Attempts at job "a" do `script["a"]` one after the other, then succeed.

    Attributes:
      script: per job id.
      seconds: that a job takes on the fake clock.
      starts: whether workers ever come up; "die" for workers that die while starting.
      start_seconds: that they take, by group.
    """

    script: dict[str, list[str]] = field(default_factory=dict)
    seconds: float = 1.0
    starts: bool | str = True
    start_seconds: dict[str, float] = field(default_factory=dict)
    now: float = 0.0
    killed: list[int] = field(default_factory=list)
    most_busy: int = 0
    attempts: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._numbers = count()
        self._tickets: dict[int, dict[str, Any]] = {}
        self._workers: dict[int, int | None] = {}
        self._groups: dict[int, str] = {}

    def clock(self) -> float:
        return self.now

    def start(self, group: Group) -> int:
        worker = next(self._numbers)
        self._workers[worker], self._groups[worker] = None, group.name
        return worker

    def ready(self, worker: int) -> int:
        fate = "die" if self.starts == "die" else ("ok" if self.starts else HANG)
        ticket = self._ticket(fate, worker, result=None)
        self._tickets[ticket]["due"] += self.start_seconds.get(self._groups[worker], 0.0)
        return ticket

    def submit(self, worker: int, job: Job) -> int:
        attempts = self.script.get(job.id, [])
        fate = attempts.pop(0) if attempts else "ok"
        self.attempts.append(job.id)
        ticket = self._ticket(fate, worker, result=(job.id, *job.arguments))
        self._workers[worker] = ticket
        busy = sum(t is not None and t in self._tickets for t in self._workers.values())
        self.most_busy = max(self.most_busy, busy)
        return ticket

    def wait(self, tickets: list[int], seconds: float) -> list[int]:
        pending = [t for t in tickets if self._tickets[t]["fate"] not in (HANG, SLOW)]
        due = min((self._tickets[t]["due"] for t in pending), default=self.now + seconds)
        self.now = max(self.now, min(due, self.now + seconds))
        return [t for t in pending if self._tickets[t]["due"] <= self.now]

    def result(self, ticket: int) -> Answer:
        known = self._tickets.pop(ticket)
        if known["fate"] == DIE:
            raise WorkerDied("killed by signal 9")
        if known["fate"] == CRASH:
            raise JobFailed("ValueError: no")
        return Answer(known["result"], self.seconds)

    def beat(self, worker: int) -> Beat | None:
        known = self._tickets.get(self._workers[worker] or -1)
        if known and known["fate"] == SLOW:  # makes progress, and is done after 20 seconds
            if self.now - known["begun"] > 20:
                known["fate"], known["due"] = "ok", self.now
            return Beat(count=int(self.now))
        return None

    def kill(self, worker: int) -> None:
        self.killed.append(worker)

    def share(self, value: Any) -> Any:
        return value

    def _ticket(self, fate: str, worker: int, result: Any) -> int:
        ticket = next(self._numbers)
        due = self.now + (0.0 if result is None else self.seconds)
        self._tickets[ticket] = {"fate": fate, "due": due, "begun": self.now, "result": result}
        return ticket
