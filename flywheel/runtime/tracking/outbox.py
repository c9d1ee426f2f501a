"""Records that wait on disk until somewhere else has taken them.

`Outbox` is the file: one JSON record a line, durable before `append` returns, and beside it how far
delivery has come. `Courier` is the thread that delivers, one record at a time and in order, for as
long as it takes. The receiver must take the same record twice without harm: a process killed
between delivery and note of it delivers once more.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from flywheel.errors import DataError, FlywheelError

log = logging.getLogger(__name__)

Record = dict[str, Any]

OUTBOX_FILE = "outbox.jsonl"
OFFSET_FILE = "outbox.offset"


class Outbox:
    """An append-only file of records with a durable delivery offset.

    Args:
      folder: where `outbox.jsonl`, `outbox.offset` and, if need be, `outbox.rejected.jsonl` live.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / OUTBOX_FILE
        self._offset_path = folder / OFFSET_FILE
        self._rejected_path = folder / "outbox.rejected.jsonl"
        self._lock = threading.Lock()
        self._end = self._drop_torn_line()
        self._delivered = self._read_offset()

    def append(self, record: Record) -> None:
        """Add a record; it is on disk when this returns."""
        line = json.dumps(record, allow_nan=False).encode() + b"\n"
        with self._lock:
            try:
                _append_durably(self.path, line)
            except OSError as error:  # a full disk may have taken half of it
                with contextlib.suppress(OSError):
                    os.truncate(self.path, self._end)
                error.filename = str(self.path)
                raise
            self._end += len(line)

    @property
    def empty(self) -> bool:
        """Everything has been delivered."""
        return self._delivered >= self._end

    def head(self) -> tuple[Record, int] | None:
        """The oldest record not delivered and the offset behind it; None if there is none."""
        with self._lock:
            if self.empty:
                return None
            with self.path.open("rb") as file:
                file.seek(self._delivered)
                line = file.readline()
        return json.loads(line), self._delivered + len(line)

    def advance(self, offset: int) -> None:
        """Note that everything before `offset` has been delivered."""
        temporary = self._offset_path.with_suffix(".offset.tmp")
        with temporary.open("w") as file:
            file.write(str(offset))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(self._offset_path)
        self._delivered = offset

    def reject(self, record: Record, reason: str) -> None:
        """Keep a record that will never be taken, with the reason, out of the way of the others."""
        line = json.dumps({"reason": reason, "record": record}).encode() + b"\n"
        _append_durably(self._rejected_path, line)

    def pending(self) -> int:
        """Number of records not yet delivered."""
        return sum(1 for _ in self.records(self._delivered))

    def records(self, offset: int = 0) -> Iterator[Record]:
        """Every record from `offset` on, delivered or not.

        Raises:
          DataError: a line is not a record; someone else has written into the file.
        """
        if self.path.exists():
            with self.path.open("rb") as file:
                file.seek(offset)
                for line in file:
                    try:
                        yield json.loads(line)
                    except ValueError:
                        text = f"{self.path} has a line that is no record: {line[:80]!r}."
                        raise DataError(text) from None

    def _drop_torn_line(self) -> int:
        """Cut off a line that a killed process left half written. Returns the file's length."""
        if not self.path.exists():
            return 0
        with self.path.open("r+b") as file:
            whole = file.read().rfind(b"\n") + 1
            file.truncate(whole)
        return whole

    def _read_offset(self) -> int:
        try:
            offset = int(self._offset_path.read_bytes())
        except (FileNotFoundError, ValueError):  # all is delivered (again), which does no harm
            return 0
        return min(max(offset, 0), self._end)


def forget_delivery(folder: Path) -> None:
    """Have everything in the outbox of a folder delivered again."""
    (folder / OFFSET_FILE).unlink(missing_ok=True)


def _append_durably(path: Path, line: bytes) -> None:
    with path.open("ab") as file:
        file.write(line)
        file.flush()
        os.fsync(file.fileno())


def _first_cause(error: BaseException) -> str:
    """The error that all others in a chain come from, in a line: clients wrap what the system says."""
    while deeper := error.__cause__ or (None if error.__suppress_context__ else error.__context__):
        error = deeper
    words = str(error).splitlines()[0] if str(error) else ""
    return words if isinstance(error, FlywheelError) else f"{type(error).__name__}: {words}"


class Courier:
    """Delivers an outbox from a thread of its own, so that a dead receiver stops nobody.

    Args:
      outbox: to empty.
      deliver: takes one record; raises if it could not be delivered.
      hopeless: whether an error says that this record will never be taken; it is then set aside.
      retry_seconds: first and longest pause after a failure [s]; it doubles from one to the other.
    """

    def __init__(
        self,
        outbox: Outbox,
        deliver: Callable[[Record], None],
        hopeless: Callable[[Exception], bool] = lambda error: False,
        retry_seconds: tuple[float, float] = (1.0, 60.0),
    ) -> None:
        self.problem = ""
        self._stuck = False  # until someone does something about the problem
        self._outbox = outbox
        self._deliver = deliver
        self._hopeless = hopeless
        self._first_pause, self._longest_pause = retry_seconds
        self._pause = self._first_pause
        self._wake = threading.Event()
        self._stopping = False
        self._idle = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="outbox", daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """There is something to deliver, or it is worth another try now."""
        self._wake.set()

    def flush(self, seconds: float) -> bool:
        """Wait until all is delivered, at most `seconds`. Returns whether it is."""
        self.wake()
        deadline = time.monotonic() + seconds
        with self._idle:
            while not self._outbox.empty and not self._stuck:
                left = deadline - time.monotonic()
                if left <= 0:
                    return False
                self._idle.wait(left)
        return self._outbox.empty

    def close(self, seconds: float) -> bool:
        """Deliver what can be delivered in `seconds`, then stop. What is left stays on disk."""
        done = self.flush(seconds)
        self._stopping = True
        self.wake()
        # A thread stuck in a hanging connection cannot be stopped; it dies with the process.
        self._thread.join(timeout=1.0)
        return done

    def _work(self) -> None:
        while True:
            self._wake.clear()
            if self._stopping:
                return
            try:
                done = self._deliver_all()
            except Exception as error:  # of the outbox itself, e.g. a full disk
                self._note(error)
                done = False
            if done:
                self._wake.wait()
            else:
                self._wake.wait(self._pause)
                self._pause = min(2 * self._pause, self._longest_pause)

    def _deliver_all(self) -> bool:
        """Deliver until nothing is left (True) or something fails (False)."""
        while (item := self._outbox.head()) is not None and not self._stopping:
            record, offset = item
            try:
                self._deliver(record)
            except Exception as error:  # no client's error may end the thread
                if not self._hopeless(error):
                    self._note(error)
                    return False
                log.warning("tracking: set aside a record that was refused: %s", error)
                self._outbox.reject(record, f"{type(error).__name__}: {error}")
            self._outbox.advance(offset)
            self._recovered()
        return True

    def _note(self, error: Exception) -> None:
        text = _first_cause(error)
        if not self.problem:
            log.warning("tracking: not delivered, kept on disk, trying again: %s", text)
        self.problem, self._stuck = text, isinstance(error, FlywheelError)
        if self._stuck:
            with self._idle:
                self._idle.notify_all()

    def _recovered(self) -> None:
        if self.problem:
            log.info("tracking: delivering again")
        self.problem, self._stuck = "", False
        self._pause = self._first_pause
        if self._outbox.empty:
            with self._idle:
                self._idle.notify_all()
