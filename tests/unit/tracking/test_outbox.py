"""The outbox: nothing that was acknowledged is lost, and nobody waits for the receiver."""

import os
import random
import signal
import subprocess
import sys
import threading
import time

import pytest

from flywheel.errors import DataError
from flywheel.runtime.tracking.tracker import Delivery, Outbox
from tests import draws

FAST = (0.01, 0.05)


class Receiver:
    """Notes what it is given; fails as long as it is told to."""

    def __init__(self):
        self.records = []
        self.error = None

    def deliver(self, record):
        if self.error is not None:
            raise self.error
        self.records.append(record)


@pytest.fixture
def receiver():
    return Receiver()


def numbers(count, start=0):
    return [{"n": n} for n in range(start, start + count)]


def test_records_arrive_once_and_in_order(tmp_path, receiver):
    outbox = Outbox(tmp_path)
    delivery = Delivery(outbox, receiver.deliver, retry_seconds=FAST)
    for record in numbers(50):
        outbox.append(record)
        delivery.wake()
    assert delivery.close(5)
    assert receiver.records == numbers(50)
    assert outbox.empty


def test_what_was_not_delivered_waits_for_the_next_process(tmp_path, receiver):
    receiver.error = ConnectionError("refused")
    first = Outbox(tmp_path)
    delivery = Delivery(first, receiver.deliver, retry_seconds=FAST)
    for record in numbers(5):
        first.append(record)
    assert not delivery.close(0.2)
    assert "refused" in delivery.problem
    receiver.error = None
    second = Outbox(tmp_path)
    assert second.pending() == 5
    assert Delivery(second, receiver.deliver, retry_seconds=FAST).close(5)
    assert receiver.records == numbers(5)
    third = Outbox(tmp_path)
    assert third.empty
    assert Delivery(third, receiver.deliver).close(1)
    assert receiver.records == numbers(5)


def test_a_receiver_that_recovers_is_noticed_without_new_records(tmp_path, receiver):
    receiver.error = TimeoutError()
    outbox = Outbox(tmp_path)
    delivery = Delivery(outbox, receiver.deliver, retry_seconds=FAST)
    outbox.append({"n": 0})
    assert not delivery.flush(0.1)
    receiver.error = None
    assert delivery.flush(5)
    assert delivery.problem == ""
    delivery.close(1)


@pytest.mark.slow
def test_a_receiver_that_hangs_blocks_neither_append_nor_flush(tmp_path):
    release = threading.Event()
    outbox = Outbox(tmp_path)
    delivery = Delivery(outbox, lambda record: release.wait(30) and None, retry_seconds=FAST)
    start = time.monotonic()
    for record in numbers(20):
        outbox.append(record)
        delivery.wake()
    assert not delivery.flush(0.3)
    assert not delivery.close(0.3)
    assert time.monotonic() - start < 3
    assert outbox.pending() == 20
    release.set()


def test_a_record_that_will_never_be_taken_is_set_aside_with_the_reason(tmp_path):
    taken = []

    def deliver(record):
        if record["n"] == 1:
            raise ValueError("no such thing")
        taken.append(record)

    outbox = Outbox(tmp_path)
    is_permanent = lambda error: isinstance(error, ValueError)  # noqa: E731
    delivery = Delivery(outbox, deliver, is_permanent, FAST)
    for record in numbers(3):
        outbox.append(record)
    assert delivery.close(5)
    assert taken == [{"n": 0}, {"n": 2}]
    aside = (tmp_path / "outbox.rejected.jsonl").read_text()
    assert "no such thing" in aside and '"n": 1' in aside


def test_a_line_torn_by_a_kill_is_dropped_and_the_rest_kept(tmp_path):
    outbox = Outbox(tmp_path)
    for record in numbers(3):
        outbox.append(record)
    with outbox.path.open("ab") as file:
        file.write(b'{"n": 3, "half')
    again = Outbox(tmp_path)
    again.append({"n": 4})
    assert list(Outbox(tmp_path).records()) == [*numbers(3), {"n": 4}]


def test_numbers_that_json_does_not_know_are_refused_before_they_are_written(tmp_path):
    outbox = Outbox(tmp_path)
    with pytest.raises(ValueError):
        outbox.append({"n": float("nan")})
    assert list(outbox.records()) == []


def test_a_full_disk_leaves_no_half_record(tmp_path, monkeypatch):
    outbox = Outbox(tmp_path)
    outbox.append({"n": 0})

    def half(path, line):
        with path.open("ab") as file:
            file.write(line[: len(line) // 2])
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr("flywheel.runtime.tracking.tracker._append_durably", half)
        with pytest.raises(OSError, match="No space"):
            outbox.append({"n": 1})
    outbox.append({"n": 2})
    assert list(outbox.records()) == [{"n": 0}, {"n": 2}]


@pytest.mark.parametrize("offset", [b"", b"\xff", b"12x", b"-5", b"9999999"])
def test_where_the_note_of_what_was_delivered_is_damaged_all_is_delivered_again(
    tmp_path, receiver, offset
):
    outbox = Outbox(tmp_path)
    for record in numbers(3):
        outbox.append(record)
    assert Delivery(outbox, receiver.deliver, retry_seconds=FAST).close(5)
    (tmp_path / "outbox.offset").write_bytes(offset)
    assert Delivery(Outbox(tmp_path), receiver.deliver, retry_seconds=FAST).close(5)
    again = [] if offset == b"9999999" else numbers(3)  # that one says: all of it
    assert receiver.records == numbers(3) + again


def test_a_problem_that_waiting_does_not_mend_is_not_waited_for_and_told_once(
    tmp_path, receiver, caplog
):
    receiver.error = DataError("The database is damaged: move it away.")
    outbox = Outbox(tmp_path)
    delivery = Delivery(outbox, receiver.deliver, retry_seconds=FAST)
    outbox.append({"n": 0})
    start = time.monotonic()
    assert not delivery.flush(30)
    assert time.monotonic() - start < 10
    time.sleep(0.1)  # it goes on trying
    assert [r.message.partition("again: ")[2] for r in caplog.records] == [
        "The database is damaged: move it away."
    ]
    receiver.error = None  # somebody moved it away
    limit = time.monotonic() + 10
    while not outbox.empty and time.monotonic() < limit:
        time.sleep(0.01)
    assert delivery.flush(5)
    assert delivery.close(1)


def test_the_first_cause_of_a_problem_is_told_not_what_clients_make_of_it(tmp_path, receiver):
    try:
        try:
            raise OSError("disk I/O error")
        except OSError as error:
            raise RuntimeError("(raised as a result of Query-invoked autoflush)\nmore") from error
    except RuntimeError as error:
        receiver.error = error
    outbox = Outbox(tmp_path)
    outbox.append({"n": 0})
    delivery = Delivery(outbox, receiver.deliver, retry_seconds=FAST)
    delivery.close(0.1)
    assert delivery.problem == "OSError: disk I/O error"


def test_a_line_that_someone_else_wrote_is_named(tmp_path):
    outbox = Outbox(tmp_path)
    with outbox.path.open("w") as file:
        file.write("hello\n")
    with pytest.raises(DataError, match="hello"):
        list(outbox.records())


WRITER = """
import sys
from pathlib import Path
from flywheel.runtime.tracking.tracker import Outbox
outbox = Outbox(Path(sys.argv[1]))
for n in range(100000):
    outbox.append({"n": n, "filling": "x" * 300})
    print(n, flush=True)
"""


@pytest.mark.slow
@pytest.mark.chaos
def test_every_record_acknowledged_before_a_kill_is_there_after_it(tmp_path):
    seed = draws.seed()
    rng = random.Random(seed)
    for attempt in range(2):
        folder = tmp_path / str(attempt)
        command = [sys.executable, "-c", WRITER, str(folder)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == "0\n"
            time.sleep(rng.uniform(0.0, 0.3))
            os.kill(writer.pid, signal.SIGKILL)
            acknowledged = [0, *map(int, writer.stdout.read().splitlines())]
        kept = [record["n"] for record in Outbox(folder).records()]
        assert kept[: len(acknowledged)] == acknowledged, f"seed {seed}"
        assert len(kept) <= len(acknowledged) + 1, f"seed {seed}"
