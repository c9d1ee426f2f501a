"""`flywheel fit`: logs in, a baseline out that other commands take."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from flywheel.cli.driving.driver import network_of
from flywheel.cli.main import app
from flywheel.cli.models import open_model, open_trained
from flywheel.data.recordings import write_recording
from flywheel.dynamics.baselines import LinearConfig, LinearDynamics, Persistence
from flywheel.dynamics.baselines.engine import RigidBodyEngine
from flywheel.dynamics.baselines.named import BASELINES
from flywheel.dynamics.baselines.weights import BaselineWeights
from flywheel.dynamics.plant import MeasurementModel, Plant
from flywheel.errors import ConfigError
from flywheel.records import Episode, Provenance, Trajectory
from flywheel.robots import load_robot
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.config.shipped import config_file

PRISM = load_robot("prism3")
FEW = ("--set", "steps=2", "--set", "horizon=0.05", "--set", "windows=5")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    plant, rng = Plant(PRISM), np.random.default_rng(0)
    controls = np.repeat(rng.uniform(-0.4, 0.4, (1, 8, 6)), 40, axis=1)
    truth = plant.simulate(plant.settle(1.0), controls)
    seen = MeasurementModel(noise=0.003).apply(truth.observations[0], PRISM, rng)
    about = Provenance(PRISM.digest, source="recording", dataset="recording")
    path = tmp_path_factory.mktemp("logs") / "monday.csv"
    episode = Episode("monday", Trajectory(seen, controls[0], 0.01), about, "train")
    write_recording(episode, path, PRISM)
    return path


def fit(*arguments):
    return CliRunner().invoke(app, ["fit", *map(str, arguments)])


@pytest.mark.parametrize(
    ("model", "more", "kind"),
    [
        ("arx", ("--set", "model.pose_lags=2"), LinearDynamics),
        ("tdpe", ("--attachments", "heuristic", "--set", "model.calibrated=0"), RigidBodyEngine),
    ],
)
def test_a_model_comes_out_that_can_be_compared_and_driven_with(log, tmp_path, model, more, kind):
    out, answer = tmp_path / "m.npz", tmp_path / "a.json"
    got = fit(model, log, "--robot", "prism3", "--out", out, "--json", answer, *FEW, *more)
    assert got.exit_code == 0, got.output
    assert f"flywheel compare {log} --robot" in got.output
    told = json.loads(answer.read_text())
    assert told["error"] <= told["before"] and told["windows"] > 0
    assert isinstance(open_model(str(out), Plant(PRISM)).dynamics, kind)
    source = config_file("prism3")
    dynamics, digest = network_of(source, load_config(source), PRISM, str(out))
    assert isinstance(dynamics, kind) and digest == told["digest"]


@pytest.mark.parametrize(
    ("robot", "left", "says"),
    [
        ("icosa6", ("npz", "json"), "trained for another robot"),
        ("prism3", ("npz",), "m.json is missing"),
    ],
)
def test_a_model_that_cannot_be_used_is_bad_input_and_no_verdict(log, tmp_path, robot, left, says):
    model = LinearDynamics(PRISM, 0.01, LinearConfig(pose_lags=1))
    BaselineWeights.of(model).write(tmp_path / "m.npz", {})
    for ending in {"npz", "json"} - set(left):
        (tmp_path / f"m.{ending}").unlink()
    csv = tmp_path / "log.csv"
    csv.write_text(log.read_text())
    asked = ["compare", str(csv), "--robot", robot, "--model", str(tmp_path / "m.npz")]
    got = CliRunner().invoke(app, asked)
    assert got.exit_code == 2 and says in " ".join(got.output.split()), got.output


def test_a_model_of_another_control_step_drives_nothing(log, tmp_path):
    out, source = tmp_path / "m.npz", config_file("prism3")
    assert fit("arx", log, "--robot", "prism3", "--out", out, "--dt", "0.02").exit_code == 0
    with pytest.raises(ConfigError, match="steps of 0.02 s"):
        network_of(source, load_config(source), PRISM, str(out))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("arx", "--attachments", "mjcf"), "has none"),
        (("arx", "--set", "model.pose_lags=0"), "from 1 to 200"),
        (("tdpe", "--set", "stepz=3"), "stepz"),
        (("tdpe", "--attachments", "some"), "uninformed"),
        (("lstm",), "arx"),
        (("arx", "--out", "m.json"), "npz"),
    ],
)
def test_bad_input_is_refused(log, arguments, says):
    got = fit(arguments[0], log, "--robot", "prism3", *arguments[1:])
    assert got.exit_code == 2 and says in got.output, got.output


@pytest.mark.parametrize("name", BASELINES)
def test_a_baseline_is_a_model_by_its_name(name):
    subject = open_model(f"mine={name}", Plant(PRISM))
    assert subject.name == "mine" and subject.dynamics.dt == 0.01
    source = config_file("prism3")
    dynamics, digest = network_of(source, load_config(source), PRISM, name)
    assert type(dynamics) is type(subject.dynamics) and digest == ""
    if name == "persistence":
        assert isinstance(dynamics, Persistence)


def test_where_a_trained_model_is_needed_a_name_is_refused():
    with pytest.raises(ConfigError, match="not fitted"):
        open_trained("tdpe", PRISM)


def test_the_list_shows_the_baselines():
    shown = CliRunner().invoke(app, ["list", "models"]).output
    assert all(name in shown for name in (*BASELINES, "arx, fitted", "tdpe, fitted"))
