"""What `flywheel diagnose` does beside diagnosing: it can be stopped, and told what matters."""

import json
import os
import shutil
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.diagnosis.heartbeat import Heartbeat
from flywheel.robots import load_robot
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.recording import Measurement, record

pytestmark = pytest.mark.slow
COMMAND = ["diagnose", "monday.csv", "--robot", "platform4", "--effects", "winch_gain,slope"]


@pytest.fixture(autouse=True)
def monday(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder with a log."""
    monkeypatch.chdir(tmp_path)
    robot = load_robot("platform4")
    hidden = hidden_effect("winch_gain").typical(robot, np.random.default_rng(0)).scaled(2.0)
    record(robot, [hidden], seconds=0.8, seed=1).write(Path(), "monday", robot)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_give_the_best_answer_so_far(number, monkeypatch):
    said = Heartbeat.__call__

    def pressed_at_the_first_fit(self: Heartbeat, note: str) -> None:
        said(self, note)
        if note.startswith("fitting") and not self.stopped():
            os.kill(os.getpid(), number)

    monkeypatch.setattr(Heartbeat, "__call__", pressed_at_the_first_fit)
    done = CliRunner().invoke(app, [*COMMAND, "--json", "answer.json"])
    assert done.exit_code == 130, done.output
    assert "the best answer so far" in done.output
    assert "best answer so far" in Path("diagnosis.html").read_text()
    answer = json.loads(Path("answer.json").read_text())
    assert answer["interrupted"]
    assert answer["ranking"][0]["effect"] == "winch_gain"


def test_when_the_minutes_are_over_it_gives_the_best_answer_so_far(monkeypatch):
    said = Heartbeat.__call__

    def over_at_the_first_fit(self: Heartbeat, note: str) -> None:
        said(self, note)
        if note.startswith("fitting"):
            self._end = time.monotonic()

    monkeypatch.setattr(Heartbeat, "__call__", over_at_the_first_fit)
    done = CliRunner().invoke(app, [*COMMAND, "--minutes", "30"])
    assert done.exit_code == 130, done.output
    assert "the best answer so far" in done.output
    nothing = CliRunner().invoke(app, [*COMMAND, "--minutes", "0.0001"])
    assert nothing.exit_code == 130
    assert "there is no answer yet" in nothing.output
    wrong = CliRunner().invoke(app, [*COMMAND, "--minutes", "0"])
    assert wrong.exit_code == 2 and "min" in wrong.output


def test_what_is_tolerated_is_said_in_millimetres() -> None:
    done = CliRunner().invoke(app, [*COMMAND, "--tolerance", "500mm"])
    assert done.exit_code == 0, done.output
    assert "which is within the tolerance" in done.output
    wrong = CliRunner().invoke(app, [*COMMAND, "--tolerance", "2miles"])
    assert wrong.exit_code == 2


def test_a_filtered_log_is_told_at_the_start_unless_its_noise_is_given() -> None:
    robot = load_robot("platform4")
    record(robot, [], seconds=0.8, seed=1, measurement=Measurement(noise=0.0)).write(
        Path(), "monday", robot
    )
    short = [*COMMAND, "--minutes", "0.0001"]
    assert "these logs seem to be filtered" in CliRunner().invoke(app, short).output
    told = CliRunner().invoke(app, [*COMMAND, "--noise", "2mm", "--json", "answer.json"])
    assert told.exit_code == 0 and "filtered" not in told.output, told.output
    assert "Noise as given: 2 mm, " in told.output
    fraction = CliRunner().invoke(app, [*short, "--noise", "0.1"]).output
    assert f"Noise as given: {100 * robot.length:.3g} mm, 10.0% of the robot's length." in " ".join(
        fraction.split()
    )
    answer = json.loads(Path("answer.json").read_text())
    assert answer["error"]["noise"] == pytest.approx(0.002)
    assert answer["settings"] == {"windows.noise": 0.002}
    wrong = CliRunner().invoke(app, [*COMMAND, "--noise", "none"])
    assert wrong.exit_code == 2 and "A length, in mm" in wrong.output


@pytest.mark.parametrize(
    "command",
    [
        "diagnose monday.csv --held-out copy.csv",
        "diagnose monday.csv ./monday.csv",
        "compare monday.csv copy.csv",
        "fit arx monday.csv copy.csv",
    ],
)
def test_a_log_is_given_once_whatever_it_is_called(command):
    for file in Path().glob("monday.*"):
        shutil.copyfile(file, file.with_stem(file.stem.replace("monday", "copy")))
    done = CliRunner().invoke(app, [*command.split(), "--robot", "platform4"])
    assert done.exit_code == 2, done.output
    assert "are the same log; give it once" in done.output
    assert not [*Path().glob("*.html"), *Path().glob("*.npz")]
