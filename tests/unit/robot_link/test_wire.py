"""What goes over the wire arrives to the bit, or is refused in words."""

import numpy as np
import pytest

from flywheel.errors import LinkError
from flywheel.robot_link import RobotInfo, Sample
from flywheel.robot_link.wire import (
    About,
    Hello,
    Measured,
    Observe,
    Ready,
    Refused,
    Reset,
    Stop,
    Stopped,
    answer_of,
    command_of,
    request_of,
)
from flywheel.robots import Robot


def test_measurements_arrive_to_the_bit_with_gaps_where_there_were_some() -> None:
    points = np.random.default_rng(0).normal(size=(4, 3))
    points[1] = np.nan
    sent = Sample(0.1 + 0.2, 0.1, points, np.array([1 / 3, np.nan]))
    line = Measured.of(sent).line()
    got = answer_of(line)
    assert b"null" in line and line.count(b"\n") == 1 and isinstance(got, Measured)
    np.testing.assert_array_equal(got.sample.points, sent.points)
    np.testing.assert_array_equal(got.sample.winch, sent.winch)
    assert (got.sample.time, got.sample.stamp) == (sent.time, sent.stamp)
    np.testing.assert_array_equal(got.sample.valid, [True, False, True, True])


def test_what_is_further_away_than_any_robot_is_not_measured() -> None:
    far = Sample(0.0, 0.0, np.array([[1e200, 0, 0], [0, np.inf, 0], [1, 2, 3]]), np.array([1e7]))
    got = answer_of(Measured.of(far).line())
    assert isinstance(got, Measured)
    np.testing.assert_array_equal(got.sample.valid, [False, False, True])
    assert np.isnan(got.sample.winch).all()


def test_a_robot_says_the_same_of_itself_at_the_other_end(prism3: Robot) -> None:
    info = RobotInfo.of(prism3, 0.02, latency=0.03, real_time=True)
    about = answer_of(About.of(info).line())
    assert isinstance(about, About)
    about.info.check_is(prism3)
    assert (about.info.period, about.info.latency, about.info.real_time) == (0.02, 0.03, True)


@pytest.mark.parametrize("message", [Hello(), Reset(seed=3), Observe(), Stop()])
def test_every_message_of_a_driver_is_read_back(message: Hello | Reset | Observe | Stop) -> None:
    assert request_of(message.line()) == message


@pytest.mark.parametrize("message", [Ready(), Stopped(), Refused(message="no")])
def test_every_answer_is_read_back(message: Ready | Stopped | Refused) -> None:
    assert answer_of(message.line()) == message


def test_a_command_is_read_back_to_the_bit() -> None:
    sent = command_of(np.array([0.1, -1 / 3]), 1.25)
    assert request_of(sent.line()) == sent
    for controls, until in (([np.nan], 1.0), ([[1.0]], 1.0), ([1.0], np.inf)):
        with pytest.raises(LinkError, match="A command consists of finite numbers"):
            command_of(np.array(controls), until)


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"\xff\xfe\n",
        b"[]\n",
        b'{"type": "fly"}\n',
        b'{"type": "send", "controls": [1, "x"], "valid_until": 1}\n',
        b'{"type": "send", "controls": [NaN], "valid_until": 1}\n',
        b'{"type": "send", "controls": [1e300], "valid_until": 1}\n',
        b'{"type": "send", "controls": [1], "valid_until": 1e30}\n',
        b'{"type": "send", "controls": [1]}\n',
        b'{"type": "observe", "more": 1}\n',
        b'{"type": "reset", "seed": -1}\n',
    ],
)
def test_what_is_no_message_is_refused_in_words(line: bytes) -> None:
    with pytest.raises(LinkError, match="The driver sent an invalid message"):
        request_of(line)


def test_a_robot_that_is_another_one_is_refused(prism3: Robot) -> None:
    info = RobotInfo.of(prism3, 0.01)
    other = About.of(info).model_copy(update={"points": ("a", "b")}).info
    with pytest.raises(LinkError, match="has the points a, b; the MJCF of prism3 has"):
        other.check_is(prism3)
    fast = About.of(info).model_copy(update={"control_high": (9.0,) * 6}).info
    with pytest.raises(LinkError, match="control_high"):
        fast.check_is(prism3)
