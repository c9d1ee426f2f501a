"""A law of one's own on its way: from a file to a diagnosis, a plant, a comparison, and a run."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.data import TrajectoryStore
from flywheel.reports import comparison_video
from flywheel.robots import load_robot
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.loop import run
from flywheel.runtime.workers.stored_episodes import effects_of
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.recording import record
from tests import own_laws

PRISM = ("--robot", "prism3")
OWN = ("--effects-from", "my_laws.py")
SMALL = """
extends: smoke
iterations: 0
control_arm: false
datasets: [{name: nominal}]
collect: {gaits: 0, random: 5, random_seconds: 1.0, drops: 0}
evaluate: {tasks: 0, oracle: false, floor: false, full: false, video: false, unseen: []}
workers: {sim: 1, trainers: 1}
effects_from: my_laws.py
effects: [{effect: cogging, parameters: {sine: 0.3, cosine: 0.0, pitch: 0.15}}]
"""


def said(*words: str, code: int) -> str:
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == code, (done.output, done.exception)
    return " ".join(done.output.split())


@pytest.mark.slow
def test_from_a_file_to_a_plant_that_predicts_better(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(comparison_video, "film_window", None)  # a page without videos
    robot = load_robot("prism3")
    hidden = hidden_effect("cogging").typical(robot, np.random.default_rng(0))
    for name, seed, seconds in (("monday", 1, 0.7), ("friday", 3, 2.0)):
        record(robot, [hidden], seconds=seconds, seed=seed).write(tmp_path, name, robot)
    own_laws.law_file(tmp_path)
    asked = ("diagnose", "monday.csv", *PRISM, "--effects", "cogging", "--json", "answer.json")
    assert "There is no effect 'cogging'" in said(*asked, code=2)
    found = said(*asked, *OWN, code=10)
    assert "flywheel design" not in found or "--effects-from my_laws.py" in found
    answer = json.loads(Path("answer.json").read_text())
    assert [law["file"] for law in answer["effects_from"]] == ["my_laws.py"]
    assert answer["error"]["augmented"] < 0.96 * answer["error"]["baseline"]

    assert "is missing: add --effects-from" in said("adopt", "answer.json", *PRISM, code=2)
    own_laws.law_file(tmp_path / "other", own_laws.COGGING + "# changed\n")
    other = ("--effects-from", "other/my_laws.py")
    assert "not the law file of the answer" in said("adopt", "answer.json", *PRISM, *other, code=2)
    adopted = said("adopt", "answer.json", *PRISM, *OWN, code=0)
    assert "effects_from=[plants/prism3-1/my_laws.py]" in adopted

    compare = ("compare", "friday.csv", *PRISM, "--horizon", "0.5", "--draws", "40")
    models = ("--model", "cogs=plants/prism3-1", "--model", "given=plant", "--json", "c.json")
    assert "has effects of the law file my_laws.py" in said(*compare, *models, code=2)
    assert "differs" in said(*compare, *models, *other, code=2)
    said(*compare, *models, *OWN, code=1)
    cogs, given = json.loads(Path("c.json").read_text())["models"]
    assert cogs["error"]["rms"] < 0.95 * given["error"]["rms"]


def test_a_law_file_is_checked_by_listing_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own_laws.law_file(tmp_path)
    listed = said("list", "effects", *OWN, code=0)
    assert "cogging" in listed and "sensor_latency" in listed
    own_laws.law_file(tmp_path, own_laws.COGGING.replace("rate * (1.0", "rate * (1.1"))
    assert "cogging of my_laws.py changes rates" in said("list", "effects", *OWN, code=2)
    assert "--effects-from is for effects" in said("list", "robots", *OWN, code=2)


@pytest.mark.nightly
@pytest.mark.ray
@pytest.mark.slow
def test_a_run_simulates_with_a_law_of_ones_own_in_other_processes(tmp_path: Path) -> None:
    law = own_laws.law_file(tmp_path)
    (tmp_path / "mine.yaml").write_text(SMALL)
    config, folder = load_config(tmp_path / "mine.yaml"), tmp_path / "run"
    law.unlink()  # nothing but the configuration knows it now
    result = run(config, folder, tracked=False)
    assert result.finished
    store = TrajectoryStore(str(folder / "store"))
    names = store.snapshot("i0000-mppi").episodes
    assert {effects_of(store.read(each.id)) for each in names} == {config.effects}
    shutil.move(folder, tmp_path / "elsewhere")
    again = load_config(tmp_path / "elsewhere" / "config.yaml")
    assert again.effects_from == config.effects_from
    assert run(again, tmp_path / "elsewhere", resume=True, tracked=False).finished
