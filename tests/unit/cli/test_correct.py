"""`flywheel correct`: logs in, a model out that other commands take."""

import json
import os
import shlex
import signal
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flywheel.cli.logs.correct import next_comparison, settings_of
from flywheel.cli.main import app
from flywheel.cli.models import open_model, open_trained
from flywheel.data.recordings import write_recording
from flywheel.dynamics.plant import MeasurementModel, Plant
from flywheel.dynamics.residual import ResidualConfig, ResidualDynamics
from flywheel.errors import ConfigError, ModelError
from flywheel.records import Episode, Provenance, Trajectory
from flywheel.robots import load_robot
from flywheel.training.residual import ResidualTraining, _Fitting

PRISM = load_robot("prism3")
SMALL = ("--horizon", "0.3", "--set", "network.width=8", "--set", "spacing=0.4")
FEW = (*SMALL, "--set", "steps=2")


@pytest.fixture
def logs(tmp_path):
    """Two logs of two seconds."""
    plant, rng, paths = Plant(PRISM), np.random.default_rng(0), []
    for name in ("monday", "tuesday"):
        controls = np.repeat(rng.uniform(-0.4, 0.4, (1, 5, 6)), 40, axis=1)
        truth = plant.simulate(plant.settle(1.0), controls)
        seen = MeasurementModel(noise=0.003).apply(truth.observations[0], PRISM, rng)
        about = Provenance(PRISM.digest, source="recording", dataset="recording")
        episode = Episode(name, Trajectory(seen, controls[0], 0.01), about, "train")
        paths.append(tmp_path / f"{name}.csv")
        write_recording(episode, paths[-1], PRISM)
    return paths


def correct(*arguments):
    return CliRunner().invoke(app, ["correct", *map(str, arguments)])


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_give_the_best_correction_so_far(logs, tmp_path, monkeypatch, number):
    next_batch = _Fitting._next_batch

    def pressed(self):
        os.kill(os.getpid(), number)
        return next_batch(self)

    monkeypatch.setattr(_Fitting, "_next_batch", pressed)
    out, answer = tmp_path / "m.npz", tmp_path / "a.json"
    many = ("--set", "steps=1000000")
    got = correct(*logs, "--robot", "prism3", "--out", out, "--json", answer, *SMALL, *many)
    assert got.exit_code == 130, got.output
    assert "the best correction so far" in got.output
    assert json.loads(answer.read_text())["best_step"] == 1
    assert open_trained(str(out), PRISM).weights.digest


@pytest.mark.slow
def test_a_model_comes_out_that_compare_and_diagnose_can_hold(logs, tmp_path):
    out, answer = tmp_path / "m.npz", tmp_path / "a.json"
    got = correct(*logs, "--robot", "prism3", "--out", out, "--json", answer, *FEW)
    assert got.exit_code == 0, got.output
    assert f"Model: {out}" in got.output
    told = json.loads(answer.read_text())
    assert told["windows"] > 0 and 0.0 <= told["share"] <= 1.0
    subject = open_model(f"mine={out}", Plant(PRISM))
    assert subject.name == "mine" and isinstance(subject.dynamics, ResidualDynamics)
    assert open_trained(str(out), PRISM).weights.digest == told["digest"]
    with pytest.raises(ModelError, match="another robot"):
        open_model(str(out), Plant(load_robot("icosa6")))
    page = tmp_path / "c.html"
    asked = [str(logs[0]), "--robot", "prism3", "--model", "plant", "--model", str(out)]
    more = ["--horizon", "0.3", "--draws", "40", "--page", str(page)]
    compared = CliRunner().invoke(app, ["compare", *asked, *more])
    assert compared.exit_code in (0, 1), compared.output
    assert page.exists()


def test_settings_are_of_the_training_or_of_the_network():
    def settings(*statements):
        given = {"horizon": 1.5, "seed": 3}
        return settings_of(statements, (ResidualConfig, {}), (ResidualTraining, given), "network")

    network, training = settings("steps=7", "network.width=32", "sure=2.5")
    assert (network.width, training.steps, training.sure) == (32, 7, 2.5)
    assert (training.horizon, training.seed) == (1.5, 3)
    for wrong in ("steps", "stepz=3", "network.width=0", "network.x=1", "steps=a"):
        with pytest.raises(ConfigError):
            settings(wrong)


@pytest.mark.parametrize("name", ["m.json", "m", "m.v1"])
def test_a_name_that_would_share_a_side_file_is_refused(tmp_path, name):
    got = correct("x.csv", "--robot", "prism3", "--out", tmp_path / name)
    assert got.exit_code == 2
    assert f"end in .npz; got {name}" in got.output


def test_the_next_command_can_be_pasted_whatever_files_are_called():
    said = next_comparison([Path("my logs/a.csv"), Path("b.csv")], "prism3", Path("my net.npz"))
    words = shlex.split(said.removeprefix("next: "))
    assert words[:3] == ["flywheel", "compare", "my logs/a.csv"] and words[-1] == "my net.npz"
