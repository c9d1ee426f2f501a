"""Progress of long computations, and their time limit."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

S = TypeVar("S")
T = TypeVar("T")
SECONDS = 5.0  # between two signs
GRACE = 10.0  # for what is left to be done when a search was stopped [s]
# What phases of a search take, in times of its first fit, before any of them is known better.
WEIGHTS = {"fit": 1.0, "score": 0.5, "search": 4.0, "judge": 1.5, "conclude": 1.5}
PHASES = tuple(WEIGHTS)
LATE = 0.25  # of the time that a phase took longer than expected, that it goes on for
MOST_KEPT = 0.25  # of a limited time, for what is done at the end
FRAMES = 4  # of a failure that are named


class Interrupted(KeyboardInterrupt):
    """A request for the best answer so far."""

    def __str__(self) -> str:
        return "Stopped before the first model was fitted and scored: there is no answer yet."


def never() -> bool:
    """No request."""
    return False


@dataclass(frozen=True)
class Failure:
    """A part of a search that was lost to an unexpected error.

    Attributes:
      what: name of the part.
      error: its kind and message.
      at: the last lines of code, the failing one first.
    """

    what: str
    error: str
    at: str

    @classmethod
    def of(cls, what: str, error: Exception) -> Failure:
        """From an error that was caught."""
        frames = traceback.extract_tb(error.__traceback__)[-FRAMES:]
        at = [f"{Path(each.filename).name}:{each.lineno} {each.name}" for each in reversed(frames)]
        return cls(what, f"{type(error).__name__}: {error}", ", ".join(at))

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {"what": self.what, "error": self.error, "at": self.at}


class Heartbeat:
    """Passes on the present step, repeats it at intervals, and knows the time limit.

    At the limit, the rest has `GRACE`; mandatory parts take as long as necessary.

    Args:
      progress: told the share of the time that is over, as far as that is known, and what is being done.
      clock: for tests.
      stop: asked whether that which computes is to end early.
      seconds: after which it is to end, from now on [s].

    Attributes:
      failures: lost parts.
    """

    def __init__(
        self,
        progress: Callable[[float, str], None] = lambda share, note: None,
        clock: Callable[[], float] = time.monotonic,
        stop: Callable[[], bool] = never,
        seconds: float = math.inf,
    ) -> None:
        self._progress, self._clock, self._stop = progress, clock, stop
        self._note, self._last = "beginning", clock()
        self._begun = self._phase_begun = clock()
        self._phase, self._ahead = PHASES[0], PHASES[1:]
        self._took: dict[str, list[float]] = {}
        self._limit, self._end, self._kept = seconds, clock() + seconds, 0.0
        self._over = math.inf  # when what may be left undone is
        self._stopped = self._heard = False
        self._patience: Callable[[], bool] = self._once
        self.failures: list[Failure] = []

    def stopped(self) -> bool:
        """True if `again` has said so: the rest must be short."""
        return self._stopped

    def phase(self, name: str, *ahead: str) -> None:
        """Another phase begins: of those ahead, or, after the search was begun anew, of these.

        How long it took the last time, or what others took, says how long it will.
        """
        now = self._clock()
        self._took.setdefault(self._phase, []).append(now - self._phase_begun)
        rest = self._ahead[self._ahead.index(name) + 1 :] if name in self._ahead else ()
        self._phase, self._ahead, self._phase_begun = name, ahead or rest, now

    def left(self) -> float:
        """The time that is probably left, from how long the phases of this search took so far [s]."""
        now = self._clock()
        spent = now - self._phase_begun
        known = [(WEIGHTS[name], sum(took) / len(took)) for name, took in self._took.items()]
        known = known or [(WEIGHTS[self._phase], (1.0 + LATE) * spent)]
        unit = sum(took for _, took in known) / sum(weight for weight, _ in known)

        def expected(name: str) -> float:
            return self._took[name][-1] if name in self._took else WEIGHTS[name] * unit

        here = max(expected(self._phase) - spent, LATE * spent)
        return max(0.0, min(here + sum(map(expected, self._ahead)), self._end - now))

    def keep(self, seconds: float) -> None:
        """Reserve so much of a limited time for the end [s]."""
        self._kept = min(seconds, MOST_KEPT * self._limit)

    def in_time(self, compute: Callable[[], T], otherwise: T, what: str = "") -> T:
        """Run optional work; returns `otherwise` if stopped early or failed."""
        return otherwise if self._stopped else self._tried(self._once, compute, otherwise, what)

    def briefly(self, compute: Callable[[], T], otherwise: T, what: str = "") -> T:
        """Run optional work until the grace period is over; returns `otherwise` after it."""
        return self._tried(self._impatient, compute, otherwise, what)

    def in_grace(self, compute: Callable[[], T]) -> T:
        """Run work without which there is no answer.

        Raises:
          Interrupted: it is unfinished when the grace period is over.
        """
        with self._patient(self._impatient):
            return compute()

    def insisted(self, compute: Callable[[], T]) -> T:
        """Run to completion; restart if interrupted."""
        with self._patient(never):
            return compute()

    def spared(self, compute: Callable[[], T], otherwise: T, what: str) -> T:
        """Run one part of many; returns `otherwise` if it fails, without ending the others."""
        try:
            return compute()
        except Exception as error:  # which nobody foresaw, or it would have been caught
            self.failures.append(Failure.of(what, error))
            return otherwise

    def each(
        self, compute: Callable[[S], T | None], parts: Iterable[S], what: Callable[[S], str]
    ) -> list[T]:
        """The results of the successful parts of many, each of which is a step to report."""
        found = []
        for part in parts:
            self(what(part))
            found.append(self.spared(partial(compute, part), None, what(part)))
        return [result for result in found if result is not None]

    def _tried(
        self, patience: Callable[[], bool], compute: Callable[[], T], otherwise: T, what: str
    ) -> T:
        try:
            with self._patient(patience):
                return self.spared(compute, otherwise, what or self._note)
        except Interrupted:
            return otherwise

    @contextmanager
    def _patient(self, patience: Callable[[], bool]) -> Iterator[None]:
        """Replace the rule by which `again` raises."""
        before, self._patience = self._patience, patience
        try:
            yield
        finally:
            self._patience = before

    def _once(self) -> bool:
        heard, self._heard = self._heard, True
        return not heard

    def _impatient(self) -> bool:
        return self._clock() >= self._over

    def __call__(self, note: str) -> None:
        """Report a new step."""
        self._note, self._last = note, self._clock()
        past, left = self._clock() - self._begun, self.left()
        self._progress(past / (past + left) if past + left > 0.0 else 0.0, note)

    def again(self) -> None:
        """Report that the step continues; to be called often.

        Raises:
          Interrupted: once, at an early end; in short work, after the grace period.
        """
        now = self._clock()
        if not self._stopped and (now >= self._end - self._kept or self._stop()):
            self._stopped = True
            self._over = GRACE + (now if now < self._end - self._kept else self._end)
            self("stopping: the best answer so far follows; Ctrl-C again ends at once")
        if self._stopped and self._patience():
            raise Interrupted
        if now - self._last >= SECONDS:
            self(self._note)
