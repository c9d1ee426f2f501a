"""Ctrl-C once asks, twice stops."""

import os
import signal
import threading

import pytest

from flywheel.runtime.pool.interrupts import StopRequest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_asks_and_the_second_stops_at_once(number):
    with StopRequest() as stop:
        assert not stop()
        os.kill(os.getpid(), number)
        assert stop()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)


def test_the_handlers_of_before_are_back_afterwards():
    before = [signal.getsignal(number) for number in StopRequest.SIGNALS]
    with StopRequest() as stop:
        os.kill(os.getpid(), signal.SIGINT)
        assert stop()
    assert [signal.getsignal(number) for number in StopRequest.SIGNALS] == before


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


def test_when_time_is_over_it_is_as_if_somebody_had_asked():
    with StopRequest(60.0) as early:
        assert not early()
    with StopRequest(0.0) as stop:
        assert stop()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
