"""What was found is adopted, and then nothing is missing any more."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flywheel.effects import EFFECTS, AdoptedPlant
from flywheel.hidden import hidden_effect
from flywheel.hidden.recording import record
from flywheel.robots import load_robot
from pipelines.cli import app

EFFECT = "cable_friction"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two recordings of one robot with an effect that its MJCF lacks."""
    robot, folder = load_robot("prism3"), tmp_path_factory.mktemp("logs")
    hidden = hidden_effect(EFFECT).typical(robot, np.random.default_rng(3)).scaled(2.0)
    paths = []
    for seed in (3, 4):
        log = record(robot, (hidden,), seconds=1.6, seed=seed)
        paths.append(log.write(folder, f"log{seed}", robot)[0])
    return paths


def diagnosed(robot: str, logs: list[Path], folder: Path) -> tuple[int, dict]:
    """Exit code and answer of the command."""
    answer = folder / "answer.json"
    arguments = [
        "diagnose", str(logs[0]), "--held-out", str(logs[1]), "--robot", robot, "--effects",
        f"{EFFECT},winch_gain,slope", "--page", str(folder / "page.html"), "--json", str(answer),
    ]  # fmt: skip
    result = CliRunner().invoke(app, arguments)
    assert answer.exists(), result.output
    return result.exit_code, json.loads(answer.read_text())


def test_from_a_recording_to_a_plant_that_explains_it(logs: list[Path], tmp_path: Path) -> None:
    code, before = diagnosed("prism3", logs, tmp_path)
    assert (code, before["verdict"]) == (10, "EFFECT")
    plants = tmp_path / "plants"
    arguments = ["adopt", str(tmp_path / "answer.json"), "--robot", "prism3", "--out", str(plants)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    adopted, robot = AdoptedPlant.read(plants / "prism3-1")
    (term,) = adopted.terms(robot, EFFECTS)
    found = before["answer_set"][0][0]
    assert term.named == {n: v["value"] for n, v in found["parameters"].items()}
    assert adopted.evidence["recordings"] == ["log3.csv"]

    code, after = diagnosed(str(plants / "prism3-1"), logs, tmp_path)
    assert (code, after["verdict"]) == (0, "NOISE_ONLY")
    assert after["error"]["baseline"] == pytest.approx(before["error"]["augmented"], rel=0.05)
    assert after["held_out"]["baseline"] < before["held_out"]["baseline"]

    again = ["adopt", str(tmp_path / "answer.json"), "--robot", str(plants / "prism3-1")]
    result = CliRunner().invoke(app, again)
    assert result.exit_code != 0
    assert "NOISE_ONLY: there is no effect to adopt" in result.output


def test_an_answer_about_another_robot_is_refused(tmp_path: Path) -> None:
    answer = tmp_path / "answer.json"
    answer.write_text(json.dumps({"answer_set": [], "robot": {"name": "mine", "digest": "abc"}}))
    result = CliRunner().invoke(app, ["adopt", str(answer), "--robot", "prism3"])
    assert result.exit_code != 0
    assert "is about mine (abc), not prism3" in " ".join(result.output.split())
