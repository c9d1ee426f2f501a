"""The README is true: its commands run (at smoke size), and it is short."""

import os
import re
import shlex
import signal
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from tests.conftest import BIN, ROOT, Stranger
from tests.readme_commands import README, code_blocks, the_two_commands

TEXT = README.read_text()
PORT = 5791


def lines_with(start: str) -> list[str]:
    """Command lines of the README's bash blocks that begin so, without their comments."""
    lines = "\n".join(code_blocks(TEXT, "bash")).splitlines()
    return [line.split("#")[0].strip() for line in lines if line.startswith(start)]


def test_the_first_command_installs_what_ci_installs_and_runs_the_default() -> None:
    first, second = the_two_commands()
    environment, install, start = (part.strip() for part in first.split("&&"))
    assert environment == "python3 -m venv .venv"
    arguments = install.removeprefix(".venv/bin/pip install -q ")
    with_the_site = arguments.replace("[dev]", "[dev,docs]")
    assert with_the_site != arguments and with_the_site in (ROOT / ".ci" / "run").read_text()
    assert start == ".venv/bin/flywheel run configs/prism3_robot.yaml"
    assert second == ".venv/bin/pytest"


def test_the_readme_is_short() -> None:
    assert len(TEXT.splitlines()) <= 130
    limits = TEXT.split("## Limits\n\n")[1].split("\n\n")[0]
    assert len(limits.splitlines()) <= 12


def test_the_site_begins_with_the_readme_s_first_command() -> None:
    (first, *_) = code_blocks((ROOT / "docs" / "index.md").read_text(), "console")
    typed = [line.removeprefix("$ ") for line in first.splitlines() if line.startswith("$ ")]
    assert " && ".join(typed) == the_two_commands()[0]


@pytest.mark.ray
@pytest.mark.slow
def test_the_first_command_runs_and_shows_what_came_of_it(first_run, stranger):
    printed, progress = first_run
    assert (stranger.folder / "runs" / "smoke_robot" / "result.json").exists()
    for shown in ("i0000-mppi", "runs/smoke_robot/report.html", "flywheel ui runs/smoke_robot"):
        assert shown in printed
    for stage in (
        "collect",
        "train",
        "drive the robot",
        "diagnose",
    ):  # as plain lines: there is no terminal
        assert stage in progress


@pytest.mark.ray
@pytest.mark.slow
@pytest.mark.usefixtures("first_run")
@pytest.mark.parametrize("command", lines_with(".venv/bin/flywheel report"))
def test_the_page_of_the_run_is_made(command: str, stranger: Stranger) -> None:
    printed, _ = stranger.ask(command)
    page = Path(re.findall(r"\S+\.html", printed)[0])
    assert (stranger.folder / page).stat().st_size > 10_000


@pytest.mark.ray
@pytest.mark.slow
@pytest.mark.usefixtures("first_run")
@pytest.mark.parametrize("command", lines_with(".venv/bin/flywheel robot reveal"))
def test_at_last_it_is_said_what_was_hidden(command: str, stranger: Stranger) -> None:
    assert "torque_speed" in stranger.ask(command)[0]


def test_the_run_without_a_robot_is_the_one_that_the_tests_make() -> None:
    assert ".venv/bin/flywheel run configs/prism3.yaml" in lines_with(".venv/bin/flywheel run")


@pytest.fixture
def dashboard(first_run: object, stranger: Stranger) -> Iterator[tuple[subprocess.Popen, str]]:
    (command,) = lines_with(".venv/bin/flywheel ui")
    small = command.replace(".venv/bin/", f"{BIN}/").replace("prism3", "smoke")
    served = subprocess.Popen(
        [*shlex.split(small), "--port", str(PORT)],
        cwd=stranger.folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert served.stdout is not None
    with served:
        yield served, served.stdout.readline()
        os.killpg(served.pid, signal.SIGINT)  # as Ctrl-C does
        try:
            served.wait(30)
        finally:
            served.kill()


@pytest.mark.nightly
@pytest.mark.ray
@pytest.mark.slow
def test_the_dashboard_of_the_run_is_served(dashboard: tuple[subprocess.Popen, str]) -> None:
    served, line = dashboard
    url = re.findall(r"http://\S+", line)[0].split("#")[0]
    until = time.monotonic() + 60
    while True:
        try:
            with urllib.request.urlopen(url, timeout=5) as page:
                assert b"MLflow" in page.read()
            return
        except OSError:
            assert served.poll() is None
            assert time.monotonic() < until
            time.sleep(0.5)


@pytest.mark.parametrize("command", lines_with(".venv/bin/flywheel robot check"))
@pytest.mark.slow
def test_a_robot_of_one_s_own_is_checked(command: str, stranger: Stranger) -> None:
    blocks = code_blocks((ROOT / "docs" / "robots.md").read_text(), "xml")
    mjcf = next(block for block in blocks if "<mujoco" in block)
    (stranger.folder / "my_robot.xml").write_text(mjcf)
    assert "It settles" in stranger.ask(command)[0]


@pytest.mark.slow
def test_every_command_in_the_table_is_one() -> None:
    table = (ROOT / "docs" / "commands.md").read_text()
    named = re.findall(r"`flywheel ([a-z ]+?)(?: [A-Z\[`]|`)", table)
    assert len(named) >= 26
    for words in named:
        command = words.split()
        command = (
            command[:2] if command[0] in {"config", "data", "robot", "recordings"} else command[:1]
        )
        assert CliRunner().invoke(app, [*command, "--help"]).exit_code == 0, words
