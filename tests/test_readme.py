"""What the README says is true: its commands run (at smoke size) and its Python runs."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.readme_commands import README, code_blocks, the_two_commands

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
TEXT = README.read_text()


def at_smoke_size(command: str) -> str:
    """A command of the README, with this environment and the smallest configuration."""
    return command.replace(".venv/bin/", f"{BIN}/").replace("prism3", "smoke")


def lines_with(start: str) -> list[str]:
    """Command lines of the README's bash blocks that begin so, without their comments."""
    lines = "\n".join(code_blocks(TEXT, "bash")).splitlines()
    return [line.split("#")[0].strip() for line in lines if line.startswith(start)]


def run(command: str, folder: Path, seconds: float) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        shlex.split(command), cwd=folder, capture_output=True, text=True, timeout=seconds
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a stranger stands: configurations, and a robot of one's own."""
    place = tmp_path_factory.mktemp("readme")
    (place / "configs").symlink_to(ROOT / "configs")
    mjcf = code_blocks((ROOT / "docs" / "robots.md").read_text(), "xml")[0]
    (place / "my_robot.xml").write_text(mjcf)
    return place


@pytest.fixture(scope="module")
def smoke_run(folder: Path) -> subprocess.CompletedProcess[str]:
    """The first command without its installation, at smoke size."""
    return run(at_smoke_size(the_two_commands()[0].split("&&")[-1]), folder, 600)


def test_the_first_command_installs_what_ci_installs_and_runs_the_default() -> None:
    first, second = the_two_commands()
    environment, install, start = (part.strip() for part in first.split("&&"))
    assert environment == "python3 -m venv .venv"
    arguments = install.removeprefix(".venv/bin/pip install -q ")
    assert arguments in (ROOT / ".ci" / "run").read_text()
    assert start == ".venv/bin/flywheel run configs/prism3.yaml"
    assert second == ".venv/bin/pytest"


@pytest.mark.ray
@pytest.mark.slow
def test_the_first_command_runs_and_shows_what_came_of_it(
    smoke_run: subprocess.CompletedProcess[str], folder: Path
) -> None:
    assert (folder / "runs" / "smoke" / "result.json").exists()
    for shown in ("i0000-mppi", "i0001-mppi", "persistence", "flywheel report runs/smoke"):
        assert shown in smoke_run.stdout
    for stage in ("collect", "train", "navigate"):  # progress, as plain lines
        assert stage in smoke_run.stderr


@pytest.mark.ray
@pytest.mark.slow
@pytest.mark.parametrize("command", lines_with(".venv/bin/flywheel report"))
def test_the_page_of_the_run_is_made(command: str, smoke_run: object, folder: Path) -> None:
    done = run(at_smoke_size(command), folder, 120)
    page = Path(re.findall(r"\S+\.html", done.stdout)[0])
    assert (folder / page).stat().st_size > 10_000


@pytest.fixture
def dashboard(smoke_run: object, folder: Path) -> Iterator[tuple[subprocess.Popen, str]]:
    (command,) = lines_with(".venv/bin/flywheel ui")
    served = subprocess.Popen(
        [*shlex.split(at_smoke_size(command)), "--port", "5791"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert served.stdout is not None
    yield served, served.stdout.readline()
    served.send_signal(signal.SIGINT)
    served.wait(30)


@pytest.mark.ray
@pytest.mark.slow
def test_the_dashboard_of_the_run_is_served(dashboard: tuple[subprocess.Popen, str]) -> None:
    served, line = dashboard
    url = re.findall(r"http://\S+", line)[0].split("#")[0]
    until = time.monotonic() + 60
    while True:
        try:
            assert b"MLflow" in urllib.request.urlopen(url, timeout=5).read()
            return
        except OSError:
            assert served.poll() is None
            assert time.monotonic() < until
            time.sleep(0.5)


@pytest.mark.parametrize("command", lines_with(".venv/bin/flywheel robot"))
def test_one_s_own_robot_is_checked(command: str, folder: Path) -> None:
    assert "It settles" in run(at_smoke_size(command), folder, 60).stdout


def test_every_command_in_the_table_is_one() -> None:
    from typer.testing import CliRunner

    from pipelines.cli import app

    named = re.findall(r"`flywheel ([a-z ]+?)(?: [A-Z\[`]|`)", TEXT)
    assert len(named) >= 9
    for words in named:
        command = words.split()
        command = command[:2] if command[0] in {"data", "robot"} else command[:1]
        assert CliRunner().invoke(app, [*command, "--help"]).exit_code == 0, words


@pytest.mark.parametrize("code", code_blocks(TEXT, "python"))
def test_the_python_runs(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(code, "README.md", "exec"), {})
    for line in code.splitlines():
        if "print(" in line and "# " in line:
            assert line.split("# ")[1].split(":")[0] in capsys.readouterr().out
