"""Publishing of a run's results in a thread, so that the run never waits for MLflow.

The outbox is the run's own folder: a result is in its files before it is published, and at the end
of each iteration everything that MLflow lacks is published. What could not be delivered is delivered
by a later attempt, or when the run is resumed.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Annotated, Generic, Literal, TypeVar

from flywheel.errors import FlywheelError
from flywheel.quantities import Bounds, Name, Place, WaitingSeconds
from flywheel.validation import Frozen

log = logging.getLogger(__name__)
Result = TypeVar("Result")

Status = Literal["RUNNING", "FINISHED", "FAILED", "KILLED"]


class TrackingConfig(Frozen):
    """Settings of tracking.

    Attributes:
      uri: "" for an SQLite file in the run folder, "http://host:port" of a tracking server, or any
        other tracking URI of MLflow.
      experiment: name of MLflow's experiment.
      registered_model: name in the model registry; "" for "flywheel-<robot>".
      request_seconds: after which a silent server counts as down [s].
      close_seconds: longest wait for undelivered results at the end of a run [s].
    """

    uri: Place = ""
    experiment: Name = "flywheel"
    registered_model: Name = ""
    request_seconds: Annotated[int, Bounds(1, 3600, "s")] = 5
    close_seconds: WaitingSeconds = 60.0


class Tracker(Generic[Result]):
    """Publishes the newest state of a run from a separate thread. No call waits for MLflow.

    Args:
      publish: takes the run so far, and its state; raises if it was not delivered. Repetition
        changes nothing.
      retry_seconds: first and longest pause after a failure [s]; the pause doubles in between.

    Attributes:
      problem: why delivery fails at present; "" if it works.
    """

    def __init__(
        self,
        publish: Callable[[Result, Status], None],
        retry_seconds: tuple[float, float] = (1.0, 60.0),
    ) -> None:
        self.problem = ""
        self._publish, self._pauses = publish, retry_seconds
        self._stuck = False  # until someone does something about the problem
        self._stopping = False
        self._latest: Result | None = None
        self._waiting: tuple[Result, Status] | None = None
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="tracker", daemon=True)
        self._thread.start()

    def show(self, result: Result, status: Status = "RUNNING") -> None:
        """Publish the run so far, in place of any earlier state of it."""
        with self._changed:
            self._latest, self._waiting = result, (result, status)
            self._changed.notify_all()

    def end(self, status: Status) -> None:
        """Publish how the run ended."""
        if self._latest is not None:
            self.show(self._latest, status)

    def flush(self, seconds: float) -> bool:
        """Wait at most `seconds` for the delivery; returns True if it is complete."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is None or self._stuck, seconds)
            return self._waiting is None

    def close(self, seconds: float) -> bool:
        """Deliver for at most `seconds`, then stop. When the run is resumed, the rest is delivered."""
        done = self.flush(seconds)
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        # A thread stuck in a hanging connection cannot be stopped; it dies with the process.
        self._thread.join(timeout=1.0)
        return done

    def _work(self) -> None:
        pause, longest = self._pauses
        while (state := self._next()) is not None:
            try:
                self._publish(*state)
            except Exception as error:  # no client's error may end the thread
                self._note(error)
                with self._changed:
                    self._changed.wait_for(
                        lambda: self._stopping or self._waiting is not state, pause
                    )
                pause = min(2 * pause, longest)
            else:
                pause = self._pauses[0]
                self._delivered(state)

    def _next(self) -> tuple[Result, Status] | None:
        """The state to publish, once there is one; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._stopping or self._waiting is not None)
            return None if self._stopping else self._waiting

    def _note(self, error: Exception) -> None:
        text = _first_cause(error)
        if not self.problem:
            log.warning("tracking: not delivered, kept on disk, trying again: %s", text)
        with self._changed:
            self.problem, self._stuck = text, isinstance(error, FlywheelError)
            self._changed.notify_all()

    def _delivered(self, state: tuple[Result, Status]) -> None:
        if self.problem:
            log.info("tracking: delivering again")
        with self._changed:
            self.problem, self._stuck = "", False
            if self._waiting is state:
                self._waiting = None
            self._changed.notify_all()


def _first_cause(error: BaseException) -> str:
    """The first error of a chain, in one line: clients wrap the operating system's message."""
    while deeper := error.__cause__ or (None if error.__suppress_context__ else error.__context__):
        error = deeper
    words = str(error).splitlines()[0] if str(error) else ""
    return words if isinstance(error, FlywheelError) else f"{type(error).__name__}: {words}"
