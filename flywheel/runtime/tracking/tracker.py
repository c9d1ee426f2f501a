"""The driver's side of tracking: events are written to disk first, and delivered to MLflow later.

`Tracker` turns events into records and appends them to the `Outbox`, a file; `Delivery`, a thread,
hands them to MLflow. So the loop never waits, and nothing is lost while the server is down. Each
record has its own time stamp and can be delivered twice without harm, because a process may be
killed between a delivery and the note of it. `publish` decides which records an iteration becomes.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

from flywheel.errors import ConfigError, DataError, FlywheelError
from flywheel.quantities import Bounds, Name, Place, WaitingSeconds
from flywheel.results import GateDecision
from flywheel.validation import Frozen

log = logging.getLogger(__name__)

Record = dict[
    str, Any
]  # what is to be done at MLflow: kind, run, time stamp [ms] and the kind's own fields
OUTBOX_FILE = "outbox.jsonl"
OFFSET_FILE = "outbox.offset"
Status = Literal["FINISHED", "FAILED", "KILLED"]


class TrackingConfig(Frozen):
    """Settings of tracking.

    Attributes:
      uri: "" for an SQLite file in the run folder, "http://host:port" of a tracking server, or any
        other tracking URI of MLflow.
      experiment: name of MLflow's experiment.
      registered_model: name in the model registry; "" for "flywheel-<robot>".
      request_seconds: after which a silent server counts as down [s].
      close_seconds: longest wait for undelivered records at the end of a run [s].
    """

    uri: Place = ""
    experiment: Name = "flywheel"
    registered_model: Name = ""
    request_seconds: Annotated[int, Bounds(1, 3600, "s")] = 5
    close_seconds: WaitingSeconds = 60.0


class Receiver(Protocol):
    """Takes the records: `mlflow_client.MlflowReceiver`, or a list in tests."""

    def deliver(self, record: Record) -> None:
        """Execute the record. Repetition changes nothing. Raises if it failed."""
        ...

    def is_permanent(self, error: Exception) -> bool:
        """True if `deliver` would raise this error every time."""
        ...


class Tracker:
    """Records events for MLflow. No call waits for MLflow; its record is on disk when it returns.

    Made by `mlflow_client.open_tracker`.

    Args:
      folder: of the run; contains the outbox and every logged file.
      key: unique name of the run, and of its parent run at MLflow; a resumed run has the same one.
      receiver: takes the records.
      close_seconds: longest wait of `close` for undelivered records [s].
      retry_seconds: first and longest pause after a failed delivery [s].
    """

    def __init__(
        self,
        folder: str | Path,
        key: str,
        receiver: Receiver,
        close_seconds: float = 60.0,
        retry_seconds: tuple[float, float] = (1.0, 60.0),
    ) -> None:
        if not re.fullmatch(r"[A-Za-z0-9._-]+", key):
            raise ConfigError(f"A run's key consists of letters, digits and . _ -, got {key!r}.")
        self.key = key
        self._folder = Path(folder).absolute()
        self._outbox = Outbox(self._folder)
        self._logged = {point for record in self._outbox.records() for point in _points(record)}
        self._open: set[str] = set()
        self._close_seconds = close_seconds
        self._delivery = Delivery(
            self._outbox, receiver.deliver, receiver.is_permanent, retry_seconds
        )

    def open(self, run: str, name: str, tags: Mapping[str, str], parent: str = "") -> None:
        """Open a run under its key, or reopen it."""
        if run not in self._open:
            self._open.add(run)
            self._put("open", run, name=name, parent=parent, tags=dict(tags))

    def log(self, run: str, values: Mapping[str, float], step: int = 0) -> None:
        """Log numbers at one step, as `log_rows` does."""
        self.log_rows(run, [(step, values)])

    def log_rows(self, run: str, rows: Iterable[tuple[int, Mapping[str, float]]]) -> None:
        """Log numbers at several steps, each only once per run, name and step.

        A number that is not finite would spoil its chart. It becomes a tag `nonfinite/<name>`, and
        the number health/nonfinite becomes 1.
        """
        finite: dict[tuple[str, int], float] = {}
        odd: dict[str, str] = {}
        for step, values in rows:
            for name, value in values.items():
                if math.isfinite(value):
                    finite[name, step] = float(value)
                else:
                    odd[f"nonfinite/{name}"] = f"{value} at {step}"
                    finite["health/nonfinite", step] = 1.0
        if odd:
            self.describe(run, tags=odd)
        new = {point: v for point, v in finite.items() if (run, *point) not in self._logged}
        if new:
            self._logged.update((run, *point) for point in new)
            self._put("log", run, values=[[name, step, v] for (name, step), v in new.items()])

    def describe(
        self, run: str, params: Mapping[str, str] = {}, tags: Mapping[str, str] = {}
    ) -> None:
        """Add constant parameters, and changeable tags, to a run."""
        self._put("describe", run, params=dict(params), tags=dict(tags))

    def dataset(self, run: str, name: str, digest: str, profile: Mapping[str, float]) -> None:
        """Name the snapshot of a run's training data.

        Args:
          run: key of the run.
          name: of the data set at MLflow.
          digest: of the snapshot. MLflow keeps 36 characters of it; a tag keeps all.
          profile: numbers about it, e.g. how many episodes.
        """
        self._put("dataset", run, name=name, digest=digest, profile=dict(profile))

    def artifact(self, run: str, path: str | Path) -> None:
        """Log a file of the run folder. It must stay there until it is delivered."""
        self._put("artifact", run, path=self._relative(path))

    def model(
        self,
        run: str,
        name: str,
        digest: str,
        folder: str | Path,
        shape: tuple[int, int],
        tags: Mapping[str, str],
        step: int = 0,
    ) -> None:
        """Log and register a model.

        Args:
          run: key of the run that made it.
          name: of the model.
          digest: of its weights.
          folder: inside the run folder, written by `pyfunc_model.write_model`.
          shape: (tracked points, winches) of its robot, for the signature.
          tags: of the model.
          step: of the run that made it.
        """
        fields = {"name": name, "digest": digest, "folder": self._relative(folder)}
        self._put("model", run, **fields, shape=list(shape), tags=dict(tags), step=step)

    def promote(self, digest: str, decision: GateDecision) -> None:
        """Move the alias `champion` to a logged model; only this moves it.

        Args:
          digest: of the model's weights.
          decision: of the gate, with its number.

        Raises:
          ConfigError: the gate did not promote the model, or its number is not finite.
        """
        if not decision.promoted or not math.isfinite(decision.number):
            raise ConfigError(
                f"Only a model that passed the gate with a finite number becomes champion; got "
                f"promoted={decision.promoted}, {decision.measure} = {decision.number}."
            )
        words = {name: str(value) for name, value in decision.model_dump().items()}
        self._put("promote", self.key, digest=digest, decision=words)

    def end(self, run: str, status: Status = "FINISHED") -> None:
        """Log the outcome of a run. The end of the parent run ends every run that is still open."""
        runs = [*sorted(self._open - {run}), run] if run == self.key else [run]
        for each in runs:
            self._open.discard(each)
            self._put("end", each, status=status)

    @property
    def problem(self) -> str:
        """Reason why delivery fails at present; "" if it works."""
        return self._delivery.problem

    def pending(self) -> int:
        """The number of undelivered records."""
        return self._outbox.pending()

    def flush(self, seconds: float) -> bool:
        """Wait at most `seconds` for the delivery of all records; returns True if it is complete."""
        return self._delivery.flush(seconds)

    def close(self, seconds: float | None = None) -> bool:
        """Deliver for at most `seconds` (by default `close_seconds`), then stop.

        Returns:
          True if all records are delivered. The next `Tracker` of this folder delivers the rest.
        """
        return self._delivery.close(self._close_seconds if seconds is None else seconds)

    def _put(self, kind: str, run: str, **fields: Any) -> None:
        now = int(1000 * time.time())
        self._outbox.append({"kind": kind, "run": run, "time": now, **fields})
        self._delivery.wake()

    def _relative(self, path: str | Path) -> str:
        try:
            return str((self._folder / path).relative_to(self._folder))
        except ValueError:
            raise ConfigError(f"Artifacts lie inside {self._folder}, got {path}.") from None


def _points(record: Record) -> Iterator[tuple[str, str, int]]:
    """(run, name, step) of each number in a record."""
    if record["kind"] == "log":
        for name, step, _ in record["values"]:
            yield (record["run"], name, step)


class Outbox:
    """A file of records, one JSON object per line, and next to it the offset of the last delivered
    record.

    Args:
      folder: of `outbox.jsonl`, `outbox.offset` and, if records were refused, `outbox.rejected.jsonl`.
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
        """Append a record; it is on disk when this returns.

        Raises:
          OSError: e.g. the disk is full; nothing was appended.
        """
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
        """Mark everything as delivered."""
        return self._delivered >= self._end

    def head(self) -> tuple[Record, int] | None:
        """The oldest undelivered record, and the offset behind it [bytes]; None if there is none."""
        with self._lock:
            if self.empty:
                return None
            with self.path.open("rb") as file:
                file.seek(self._delivered)
                line = file.readline()
        return json.loads(line), self._delivered + len(line)

    def advance(self, offset: int) -> None:
        """Mark everything before `offset` as delivered."""
        temporary = self._offset_path.with_suffix(".offset.tmp")
        with temporary.open("w") as file:
            file.write(str(offset))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(self._offset_path)
        self._delivered = offset

    def reject(self, record: Record, reason: str) -> None:
        """Set a record aside that MLflow always rejects, with the reason."""
        line = json.dumps({"reason": reason, "record": record}).encode() + b"\n"
        _append_durably(self._rejected_path, line)

    def pending(self) -> int:
        """The number of undelivered records."""
        return sum(1 for _ in self.records(self._delivered))

    def records(self, offset: int = 0) -> Iterator[Record]:
        """Every record from `offset` on, delivered or not.

        Raises:
          DataError: a line is not a record.
        """
        if self.path.exists():
            with self.path.open("rb") as file:
                file.seek(offset)
                for line in file:
                    try:
                        yield json.loads(line)
                    except ValueError:
                        text = f"{self.path} has a line that is not a record: {line[:80]!r}."
                        raise DataError(text) from None

    def _drop_torn_line(self) -> int:
        """Remove an incomplete line of a killed process; returns the file's length [bytes]."""
        if not self.path.exists():
            return 0
        with self.path.open("r+b") as file:
            whole = file.read().rfind(b"\n") + 1
            file.truncate(whole)
        return whole

    def _read_offset(self) -> int:
        try:
            offset = int(self._offset_path.read_bytes())
        except (FileNotFoundError, ValueError):  # all is delivered again, which does no harm
            return 0
        return min(max(offset, 0), self._end)


def forget_delivery(folder: Path) -> None:
    """Mark every record of a folder's outbox as undelivered."""
    (folder / OFFSET_FILE).unlink(missing_ok=True)


def _append_durably(path: Path, line: bytes) -> None:
    with path.open("ab") as file:
        file.write(line)
        file.flush()
        os.fsync(file.fileno())


def _first_cause(error: BaseException) -> str:
    """The first error of a chain, in one line: clients wrap the operating system's message."""
    while deeper := error.__cause__ or (None if error.__suppress_context__ else error.__context__):
        error = deeper
    words = str(error).splitlines()[0] if str(error) else ""
    return words if isinstance(error, FlywheelError) else f"{type(error).__name__}: {words}"


class Delivery:
    """Delivers an outbox, one record at a time and in order, from a separate thread.

    Args:
      outbox: of the records.
      deliver: takes one record; raises if it could not be delivered.
      is_permanent: True for an error after which a record will never be accepted; it is then set
        aside.
      retry_seconds: first and longest pause after a failure [s]; the pause doubles in between.
    """

    def __init__(
        self,
        outbox: Outbox,
        deliver: Callable[[Record], None],
        is_permanent: Callable[[Exception], bool] = lambda error: False,
        retry_seconds: tuple[float, float] = (1.0, 60.0),
    ) -> None:
        self.problem = ""
        self._stuck = False  # until someone does something about the problem
        self._outbox = outbox
        self._deliver = deliver
        self._is_permanent = is_permanent
        self._first_pause, self._longest_pause = retry_seconds
        self._pause = self._first_pause
        self._wake = threading.Event()
        self._stopping = False
        self._idle = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="outbox", daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Try to deliver now."""
        self._wake.set()

    def flush(self, seconds: float) -> bool:
        """Wait at most `seconds` for the delivery of all records; returns True if it is complete."""
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
        """Deliver for at most `seconds`, then stop. The rest stays on disk."""
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
                if not self._is_permanent(error):
                    self._note(error)
                    return False
                log.warning("tracking: set aside a record that was rejected: %s", error)
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
