"""The tracker's thread: nobody waits for the receiver, and the newest state arrives in the end."""

import threading
import time

import pytest

from flywheel.errors import DataError
from flywheel.results import RunResult
from flywheel.runtime.tracking.tracker import Tracker

FAST = (0.01, 0.05)
FIRST, SECOND = RunResult(name="first", key="key"), RunResult(name="second", key="key")


class Receiver:
    """Notes what it is given; fails as long as it is told to."""

    def __init__(self):
        self.got = []
        self.error = None

    def publish(self, result, status):
        if self.error is not None:
            raise self.error
        self.got.append((result.name, status))


@pytest.fixture
def receiver():
    return Receiver()


def test_a_state_and_how_the_run_ended_arrive(receiver):
    tracker = Tracker(receiver.publish, FAST)
    tracker.show(FIRST)
    assert tracker.flush(5)
    tracker.show(SECOND)
    tracker.end("KILLED")
    assert tracker.close(5)
    assert receiver.got[0] == ("first", "RUNNING")
    assert receiver.got[-1] == ("second", "KILLED")


def test_a_run_that_ends_before_it_showed_anything_publishes_nothing(receiver):
    tracker = Tracker(receiver.publish, FAST)
    tracker.end("FAILED")
    assert tracker.close(5)
    assert receiver.got == []


def test_a_receiver_that_recovers_gets_only_the_newest_state(receiver):
    receiver.error = TimeoutError("refused")
    tracker = Tracker(receiver.publish, FAST)
    tracker.show(FIRST)
    tracker.show(SECOND)
    assert not tracker.flush(0.1)
    assert "refused" in tracker.problem
    receiver.error = None
    assert tracker.flush(5)
    assert tracker.problem == ""
    assert tracker.close(1)
    assert receiver.got == [("second", "RUNNING")]


def test_a_new_state_is_tried_at_once_however_long_the_pause_is(receiver):
    receiver.error = ConnectionError()
    tracker = Tracker(receiver.publish, (60.0, 60.0))
    tracker.show(FIRST)
    limit = time.monotonic() + 5
    while not tracker.problem and time.monotonic() < limit:
        time.sleep(0.01)
    receiver.error = None
    tracker.show(SECOND)
    assert tracker.close(5)
    assert receiver.got == [("second", "RUNNING")]


def test_a_receiver_that_hangs_blocks_nobody():
    release = threading.Event()
    tracker = Tracker(lambda result, status: release.wait(30) and None, FAST)
    start = time.monotonic()
    tracker.show(FIRST)
    assert not tracker.flush(0.3)
    assert not tracker.close(0.3)
    assert time.monotonic() - start < 3
    release.set()


def test_a_problem_that_waiting_does_not_mend_is_not_waited_for_and_told_once(receiver, caplog):
    receiver.error = DataError("The database is damaged: move it away.")
    tracker = Tracker(receiver.publish, FAST)
    tracker.show(FIRST)
    start = time.monotonic()
    assert not tracker.flush(30)
    assert time.monotonic() - start < 10
    time.sleep(0.1)  # it goes on trying
    assert [r.message.partition("again: ")[2] for r in caplog.records] == [
        "The database is damaged: move it away."
    ]
    receiver.error = None  # somebody moved it away
    limit = time.monotonic() + 10
    while not receiver.got and time.monotonic() < limit:
        time.sleep(0.01)
    assert tracker.close(5)


def test_the_first_cause_of_a_problem_is_told_not_what_clients_make_of_it(receiver):
    try:
        try:
            raise OSError("disk I/O error")
        except OSError as error:
            raise RuntimeError("(raised as a result of Query-invoked autoflush)\nmore") from error
    except RuntimeError as error:
        receiver.error = error
    tracker = Tracker(receiver.publish, FAST)
    tracker.show(FIRST)
    tracker.close(0.2)
    assert tracker.problem == "OSError: disk I/O error"
