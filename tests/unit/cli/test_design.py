"""`flywheel design`: commands that are there, also where it was stopped."""

import json
import os
import signal
from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.diagnosis.experiments.design import Designer, Tried
from flywheel.records import Floats

COMMAND = "design winch_gain slope --robot platform4 --seconds 0.3 --candidates 4 --json d.json"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_give_the_best_commands_so_far(number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tried = Designer._tried

    def pressed(self: Designer, wishes: Sequence[Floats], families: Sequence[str]) -> Tried:
        os.kill(os.getpid(), number)
        return tried(self, wishes, families)

    monkeypatch.setattr(Designer, "_tried", pressed)
    done = CliRunner().invoke(app, COMMAND.split())
    assert done.exit_code == 130, done.output
    assert "the best commands so far" in done.output
    assert Path("commands.csv").read_text().count("\n") > 30
    assert json.loads(Path("d.json").read_text())["tried"] == 4
