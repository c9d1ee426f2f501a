"""A robot in one process and its driver in another: to the end, and with either of them killed."""

import csv
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from flywheel.robot_link import TcpLink

FLYWHEEL = [sys.executable, "-m", "flywheel.cli"]
SMALL = ["mppi.samples=2", "mppi.horizon_seconds=1", "task.radius=[3,4]"]


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def server(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[subprocess.Popen[str], str, Path]]:
    """`flywheel robot serve` in real time, its address, and the file that it writes to."""
    said = tmp_path_factory.mktemp("server") / "server.txt"
    command = [*FLYWHEEL, "robot", "serve", "prism3", "--hidden", "torque_speed", "--port", "0"]
    with said.open("w") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, text=True)
    try:
        until = time.monotonic() + 240
        while "waits" not in said.read_text():
            assert time.monotonic() < until and process.poll() is None, said.read_text()
            time.sleep(0.05)
        address = said.read_text().split("tcp://")[1].split()[0].rstrip(".")
        yield process, f"tcp://{address}", said
    finally:
        process.kill()
        process.wait()


@contextmanager
def driver(address: str, folder: Path, seconds: float) -> Iterator[subprocess.Popen[str]]:
    options = ["--model", "plant", "--robot", address, "--logs", str(folder)]
    with subprocess.Popen(
        [*FLYWHEEL, "drive", "smoke", *options, *SMALL, f"task.seconds={seconds}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_for(said: Path, before: int, words: str) -> None:
    """Wait until the server says something more often than it has before."""
    until = time.monotonic() + 240
    while said.read_text().count(words) <= before:
        assert time.monotonic() < until, said.read_text()
        time.sleep(0.05)


def on_its_way(folder: Path) -> None:
    """Wait until a drive has measured for a while."""
    until = time.monotonic() + 240
    while not any(file.read_text().count("\n") > 50 for file in folder.glob("*.jsonl")):
        assert time.monotonic() < until
        time.sleep(0.05)


def rows(folder: Path) -> list[list[str]]:
    (file,) = folder.glob("*.csv")
    with file.open() as lines:
        return list(csv.reader(lines))


@pytest.mark.nightly
def test_a_drive_in_real_time_leaves_a_whole_log(server, tmp_path):
    _, address, said = server
    with driver(address, tmp_path / "logs", 2.0) as driving:
        out, _ = driving.communicate(timeout=240)
    assert driving.returncode == 0 and "remained" in out, out
    assert len(rows(tmp_path / "logs")) == 1 + 201
    assert "the robot holds still" in said.read_text()


def test_a_drive_that_is_asked_to_end_leaves_a_whole_log(server, tmp_path):
    _, address, said = server
    before = said.read_text().count("drives")
    with driver(address, tmp_path / "logs", 100.0) as driving:
        on_its_way(tmp_path / "logs")
        for _ in range(2):  # as `timeout` does
            driving.send_signal(signal.SIGTERM)
        out, _ = driving.communicate(timeout=240)
    assert driving.returncode == 130 and "stopped after" in out, out
    assert len(rows(tmp_path / "logs")) > 5
    wait_for(said, before, "the robot holds still")


@pytest.mark.nightly
def test_a_killed_driver_leaves_a_robot_that_holds_still_and_takes_the_next(server, tmp_path):
    _, address, said = server
    before = said.read_text().count("drives")
    with driver(address, tmp_path / "logs", 100.0) as driving:
        on_its_way(tmp_path / "logs")
        driving.kill()
        driving.communicate()
    wait_for(said, before, "the robot holds still")
    host, _, port = address.removeprefix("tcp://").partition(":")
    TcpLink(host, int(port)).close()
    wait_for(said, before + 1, "the robot holds still")


@pytest.mark.nightly
def test_a_lost_robot_ends_the_drive_with_a_whole_log(server, tmp_path):
    process, address, _ = server
    with driver(address, tmp_path / "logs", 100.0) as driving:
        on_its_way(tmp_path / "logs")
        process.send_signal(signal.SIGKILL)
        out, _ = driving.communicate(timeout=240)
    assert driving.returncode == 1, out
    assert "the link was lost after" in out and "is lost: " in out
    table = rows(tmp_path / "logs")
    assert len(table) > 5 and all(len(row) == len(table[0]) for row in table)
