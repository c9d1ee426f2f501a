"""Ctrl-C once asks, twice stops; what is started with nohup, or as a script's `&`, hears nothing of it."""

import os
import signal
import threading
import time

import pytest

from flywheel.runtime.pool.interrupts import ONE_WISH, SIGNALS, StopRequest

LATER = 1.1 * ONE_WISH


@pytest.fixture
def wait(monkeypatch):
    """Lets time pass at once."""
    now = [time.monotonic()]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def wait(seconds: float) -> None:
        now[0] += seconds

    return wait


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_asks_and_the_second_stops_at_once(number, wait):
    with StopRequest() as stop:
        assert not stop()
        os.kill(os.getpid(), number)
        assert stop()
        wait(LATER)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)


def test_a_signal_that_comes_twice_in_a_moment_is_one_wish(wait):
    with StopRequest() as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        wait(0.9 * ONE_WISH)
        os.kill(os.getpid(), signal.SIGTERM)  # as `timeout` sends it, and the group of a terminal
        assert stop()


def test_the_end_of_the_terminal_asks_and_never_stops_what_was_asked(wait):
    with StopRequest() as stop:
        for _ in range(3):
            os.kill(os.getpid(), signal.SIGHUP)
            assert stop()
            wait(LATER)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_that_is_ignored_stays_ignored(number):
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with StopRequest() as stop:
            os.kill(os.getpid(), number)
            assert not stop()
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, before)


def test_the_handlers_of_before_are_back_afterwards():
    before = [signal.getsignal(number) for number in SIGNALS]
    with StopRequest() as stop:
        os.kill(os.getpid(), signal.SIGINT)
        assert stop()
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_a_request_inside_another_thread_can_be_made_without_signals():
    seen = []

    def body():
        with StopRequest() as stop:
            stop.ask()
            seen.append(stop())

    thread = threading.Thread(target=body)
    thread.start()
    thread.join()
    assert seen == [True]
