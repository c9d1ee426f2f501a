"""The `flywheel` command: instant help that teaches, clean messages, and exit codes."""

import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from flywheel.cli.exits import Commands
from flywheel.cli.list import LISTS, Kind
from flywheel.cli.main import app
from flywheel.errors import (
    ConfigError,
    DataError,
    FlywheelError,
    ModelError,
    RobotError,
    RunError,
    UnknownNameError,
)
from flywheel.runtime.pool.interrupts import Interrupted
from flywheel.runtime.pool.jobs import JobFailed, WorkerDied

ROOT = Path(__file__).parents[3]
COMMANDS = (
    ["run"],
    ["list"],
    ["evaluate"],
    ["navigate"],
    ["report"],
    ["ui"],
    ["data", "verify"],
    ["data", "show"],
    ["robot", "check"],
    ["recordings", "import"],
    ["recordings", "show"],
    ["recordings", "export"],
    ["diagnose"],
    ["adopt"],
    ["compare"],
    ["power"],
    ["design"],
    ["config", "copy"],
)
run = CliRunner().invoke


def raising(error: BaseException) -> typer.Typer:
    """A command of its own that raises the error."""
    small = typer.Typer(cls=Commands, pretty_exceptions_enable=False)

    @small.callback()
    def top(debug: bool = False) -> None:
        """The top."""

    @small.command()
    def work() -> None:
        raise error

    return small


def test_help_imports_none_of_the_engines() -> None:
    code = (
        "import sys, flywheel.cli.main\n"
        "print(*{'torch', 'mujoco', 'ray', 'mlflow', 'numpy', 'zarr'} & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize("module", ["flywheel.cli", "flywheel.cli.main"])
def test_it_runs_as_a_module(module: str) -> None:
    command = [sys.executable, "-m", module, "list", "tasks"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "reach" in done.stdout


@pytest.mark.parametrize("command", COMMANDS, ids="-".join)
def test_every_command_explains_itself_with_an_example(command: list[str]) -> None:
    done = run(app, [*command, "--help"])
    assert done.exit_code == 0
    assert "Example" in done.output
    assert f"flywheel {' '.join(command)} " in done.output


def test_help_names_every_command_and_the_exit_codes() -> None:
    done = run(app, ["--help"])
    for command in COMMANDS:
        assert command[0] in done.output
    for code in ("0 all is well", "1 a check failed", "2 bad", "70 a bug", "130 interrupted"):
        assert code in done.output


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (RunError("x"), 1),
        (ModelError("x"), 1),
        (WorkerDied("x"), 1),
        (JobFailed("x"), 70),
        (ConfigError("x"), 2),
        (DataError("x"), 2),
        (RobotError("x"), 2),
        (UnknownNameError("x"), 2),
        (FlywheelError("x"), 2),
        (Interrupted("x"), 130),
        (KeyboardInterrupt(), 130),
    ],
    ids=lambda value: type(value).__name__,
)
def test_each_kind_of_error_has_its_exit_code(error: BaseException, code: int) -> None:
    assert run(raising(error), ["work"]).exit_code == code


def test_an_error_is_one_message_and_debug_shows_where_it_was_raised() -> None:
    plain = run(raising(RunError("the disk is full")), ["work"])
    assert plain.stderr == "flywheel: the disk is full\n"
    full = run(raising(JobFailed("it broke", trace="in worker 3")), ["--debug", "work"])
    assert "Traceback" in full.stderr
    assert "in worker 3" in full.stderr
    assert "\nflywheel: " in full.stderr
    assert "it broke" in full.stderr


def test_every_kind_of_list_has_a_maker() -> None:
    assert {kind.value for kind in Kind} == LISTS.keys()


@pytest.mark.parametrize("kind", LISTS)
def test_a_list_names_what_is_there(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    done = run(app, ["list", kind], catch_exceptions=False)
    assert done.exit_code == 0
    expected = {
        "robots": "prism3",
        "tasks": "reach",
        "models": "lean",
        "controllers": "mppi",
        "effects": "rolling_resistance",
        "datasets": "nominal",
        "configs": "paper/training",
    }
    assert expected.get(kind, "") in done.output


def test_a_missing_configuration_is_bad_input_and_the_known_ones_are_listed(monkeypatch):
    monkeypatch.chdir(ROOT)
    done = run(app, ["run", "configs/prism4.yaml"])
    assert done.exit_code == 2
    assert "prism3.yaml" in done.stderr


@pytest.mark.parametrize(
    "command", ["evaluate", "report", "ui", "data show", "data verify", "recordings show"]
)
def test_a_folder_without_a_run_is_bad_input(command: str, tmp_path: Path) -> None:
    done = run(app, [*command.split(), str(tmp_path / "nothing")])
    assert done.exit_code == 2
    assert "nothing" in done.stderr
