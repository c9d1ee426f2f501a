"""The same robot, reached in different ways."""

import json
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from flywheel.errors import ConfigError, LinkError
from flywheel.records import Floats
from flywheel.robot_link import (
    ReplayedLink,
    RobotInfo,
    RobotLink,
    Sample,
    SimulatedLink,
    StandIn,
    StandInConfig,
    TcpLink,
    TranscribedLink,
)
from flywheel.robot_link.opening import open_link
from flywheel.robot_link.own import OwnLink
from flywheel.robots import Robot, load_robot
from tests.unit.robot_link.conftest import PERIOD, Serve

CONFIG = StandInConfig(hidden=("torque_speed", "command_delay"), dropout=0.1)


def play(link: RobotLink, steps: int = 12) -> Floats:
    """(steps + 1, P, 3) measured while all winches haul in."""
    link.reset(3)
    samples = [link.observe()]
    for _ in range(steps):
        link.send(np.full(6, -0.2), samples[-1].time + 0.1)
        samples.append(link.observe())
    link.stop()
    return np.array([sample.points for sample in samples])


@pytest.fixture(scope="module")
def expected() -> Floats:
    return play(StandIn(load_robot("prism3"), CONFIG, PERIOD))


def test_a_robot_behind_a_port_measures_the_same_to_the_bit(serve: Serve, expected: Floats) -> None:
    link = TcpLink("127.0.0.1", serve(CONFIG))
    try:
        np.testing.assert_array_equal(play(link), expected)
    finally:
        link.close()


def test_in_real_time_a_period_takes_its_time(serve: Serve, expected: Floats) -> None:
    link, begun = TcpLink("127.0.0.1", serve(CONFIG, True)), time.monotonic()
    try:
        assert link.info.real_time
        np.testing.assert_array_equal(play(link)[0], expected[0])
    finally:
        link.close()
    assert time.monotonic() - begun > 12 * PERIOD


def test_a_stand_in_in_a_process_of_its_own_measures_the_same_to_the_bit(prism3, expected):
    link = SimulatedLink(prism3, CONFIG, PERIOD)
    np.testing.assert_array_equal(play(link), expected)
    process = link._process
    link.close()
    assert process.returncode is not None


def test_a_stand_in_that_cannot_be_says_why(prism3: Robot) -> None:
    with pytest.raises(LinkError, match="must be a multiple of the control period"):
        SimulatedLink(prism3, StandInConfig(latency=0.015), PERIOD)


def test_in_real_time_the_robot_goes_on_without_its_driver(serve: Serve) -> None:
    link = TcpLink("127.0.0.1", serve(StandInConfig(winch_measured=True, noise=0.0), True))
    try:
        link.reset()
        first = link.observe()
        link.send(np.full(6, -0.1), first.time + 0.05)
        time.sleep(0.2)
        later = link.observe()
        assert later.time - first.time > 0.15  # at once, and not only one period later
        assert later.winch[0] - first.winch[0] == pytest.approx(-0.005, abs=0.0011)
    finally:
        link.close()


def test_one_at_a_time_may_drive(serve: Serve) -> None:
    port = serve()
    first = TcpLink("127.0.0.1", port)
    with pytest.raises(LinkError, match="Somebody else drives this robot"):
        TcpLink("127.0.0.1", port)
    first.close()
    time.sleep(0.1)
    TcpLink("127.0.0.1", port).close()


@pytest.mark.parametrize(
    ("lines", "answer"),
    [
        (b'{"type": "observe"}\n', "The first message must be hello"),
        (b'{"type": "hello", "format": 9}\n', "uses format 9"),
        (b'{"type": "hello"}\nnonsense\n', "an invalid message"),
        (b'{"type": "hello"}\n{"type": "observe"}\n', "must be reset"),
        (
            b'{"type": "hello"}\n{"type": "reset"}\n{"type":"send","controls":[1],"valid_until":1}\n',
            "6",
        ),
        (b'{"type": "hello"}\n' + b" " * 1_100_000, "at most 1,000,000 bytes"),
    ],
)
def test_a_driver_that_talks_nonsense_is_told_so_and_let_go(serve, lines, answer):
    port = serve()
    with socket.create_connection(("127.0.0.1", port), timeout=10) as wire:
        wire.sendall(lines)
        *_, last = wire.makefile("rb").read().splitlines()
    assert json.loads(last)["type"] == "error"
    assert answer in json.loads(last)["message"]
    TcpLink("127.0.0.1", port).close()  # the next one is let in


def test_a_robot_that_is_not_there_hangs_up_or_is_silent_is_said_to_be_lost(serve: Serve) -> None:
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        port = nobody.getsockname()[1]
        with pytest.raises(LinkError, match="no answer within 0.2 s"):
            TcpLink("127.0.0.1", port, patience=0.2)
    with pytest.raises(LinkError, match=f"No robot answers at 127.0.0.1:{port}"):
        TcpLink("127.0.0.1", port)


def test_an_answer_that_comes_byte_by_byte_and_never_ends_is_too_late() -> None:
    def drip(server: socket.socket) -> None:
        with server.accept()[0] as wire, suppress(OSError):
            for _ in range(400):
                wire.sendall(b" ")
                time.sleep(0.05)

    with socket.create_server(("127.0.0.1", 0)) as server:
        dripping = threading.Thread(target=drip, args=[server])
        dripping.start()
        with pytest.raises(LinkError, match="no answer within 0.3 s"):
            TcpLink("127.0.0.1", server.getsockname()[1], patience=0.3)
        dripping.join()


def test_a_transcript_takes_the_place_of_the_robot(prism3, expected, tmp_path):
    path = tmp_path / "episodes" / "one.jsonl"
    link = TranscribedLink(StandIn(prism3, CONFIG, PERIOD), path)
    np.testing.assert_array_equal(play(link), expected)
    link.close()
    np.testing.assert_array_equal(play(ReplayedLink(path)), expected)


def test_a_transcript_of_another_run_is_refused(prism3: Robot, tmp_path: Path) -> None:
    path = tmp_path / "one.jsonl"
    link = TranscribedLink(StandIn(prism3, CONFIG, PERIOD), path)
    play(link, steps=2)
    link.close()
    replayed = ReplayedLink(path)
    replayed.reset(3)
    replayed.observe()
    with pytest.raises(LinkError, match="was written by another run"):
        replayed.send(np.zeros(6), 0.1)
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-2]))
    with pytest.raises(LinkError, match="ends before the episode does"):
        play(ReplayedLink(path), steps=2)
    with pytest.raises(LinkError, match="cannot be read"):
        ReplayedLink(tmp_path / "none.jsonl")


class OwnRobot:
    """A link of one's own: a robot that lies still."""

    def __init__(self, robot: Robot, period: str = "0.01") -> None:
        self.info = RobotInfo.of(robot, float(period))
        self.closed = False
        self._points = np.zeros((len(robot.points), 3))

    def reset(self, seed: int = 0) -> None:
        self._time = 0.0

    def observe(self) -> Sample:
        self._time += self.info.period
        return Sample(self._time, self._time, self._points, np.zeros(6))

    def send(self, controls: Floats, valid_until: float) -> None: ...

    def stop(self) -> None: ...

    def close(self) -> None:
        self.closed = True


def test_a_link_of_one_s_own_is_found_by_its_name(prism3: Robot) -> None:
    link = open_link(f"{__name__}:OwnRobot", prism3, 0.02, arguments={"period": "0.02"})
    assert isinstance(link, OwnLink) and isinstance(link.own, OwnRobot)


@pytest.mark.parametrize(
    ("where", "arguments", "message"),
    [
        (
            "smoke signals",
            {},
            'by "simulated", "tcp://HOST:PORT", "ros://HOST:PORT" or "MODULE:CLASS"',
        ),
        ("tcp://host:99999", {}, "no port from 1 to 65535"),
        ("tcp://host:1/path", {}, "reached by tcp://HOST:PORT"),
        ("no_such_module:Robot", {}, "no_such_module cannot be imported"),
        (f"{__name__}:Nothing", {}, "has no Nothing"),
        (f"{__name__}:OwnRobot", {"speed": "1"}, "cannot be made from a robot and"),
        ("json:JSONDecoder", {}, "cannot be made"),
        ("builtins:repr", {}, "is not a RobotLink"),
        ("simulated", {"port": "1"}, r"Arguments \(port\) are those of .*'simulated' takes none"),
        ("tcp://host:1", {"latency": "1"}, r"'tcp://host:1' takes none"),
    ],
)
def test_a_way_that_leads_nowhere_is_refused(prism3, where, arguments, message):
    with pytest.raises((ConfigError, LinkError), match=message):
        open_link(where, prism3, PERIOD, arguments=arguments)


@pytest.mark.parametrize("where", ["tcp://host:1", "ros://host:1", f"{__name__}:OwnRobot"])
def test_a_robot_with_its_own_physics_takes_no_description_of_a_stand_in(prism3, where):
    stand_in = StandInConfig(hidden=("payload",), noise=0.0)
    with pytest.raises(ConfigError, match=r"A stand-in \(hidden, noise\) goes with simulated"):
        open_link(where, prism3, PERIOD, stand_in)


def test_another_control_period_than_the_model_s_is_refused(prism3: Robot) -> None:
    with pytest.raises(LinkError, match=r"control period is 0.01 s, the model's control step"):
        open_link(f"{__name__}:OwnRobot", prism3, 0.02)
