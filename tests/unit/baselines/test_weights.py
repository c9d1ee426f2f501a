"""Fitted baselines in files: the same model comes back, and nothing else is taken for one."""

import json

import numpy as np
import pytest

from flywheel.cli.models import open_model
from flywheel.dynamics.baselines import LinearConfig, LinearDynamics
from flywheel.dynamics.baselines.engine import EngineConfig, RigidBodyEngine
from flywheel.dynamics.baselines.weights import BaselineWeights, FitModel
from flywheel.dynamics.plant import Plant
from flywheel.errors import FlywheelError, ModelError
from flywheel.robots import load_robot

ROBOT = load_robot("prism3")
MODELS: dict[str, FitModel] = {
    "arx": LinearDynamics(
        ROBOT, 0.01, LinearConfig(pose_lags=2, input_lags=3), np.full((79, 18), 0.25)
    ),
    "tdpe": RigidBodyEngine(
        ROBOT,
        0.02,
        EngineConfig(attachments="heuristic", calibrated=False),
        np.array([0.1, 0.3, 0.9, 0.8, 0.7]),
    ),
}


@pytest.mark.parametrize("kind", MODELS)
def test_a_written_model_is_read_as_it_was(kind, tmp_path) -> None:
    model, path = MODELS[kind], tmp_path / "m.npz"
    digest = BaselineWeights.of(model).write(path, {"note": 1})
    subject = open_model(f"mine={path}", Plant(ROBOT))
    got = subject.dynamics
    assert type(got) is type(model) and subject.name == "mine"
    assert got.dt == model.dt and got.config == model.config
    for name, values in model.arrays.items():
        np.testing.assert_array_equal(got.arrays[name], values)
    assert BaselineWeights.read(path, ROBOT).digest == digest == BaselineWeights.of(got).digest


def test_another_robot_is_refused(tmp_path) -> None:
    BaselineWeights.of(MODELS["tdpe"]).write(tmp_path / "m.npz")
    with pytest.raises(ModelError, match="another robot"):
        BaselineWeights.read(tmp_path / "m.npz", load_robot("icosa6"))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("kind", "arx"),
        ("kind", "mine"),
        ("dt", 0.05),
        ("dt", -1),
        ("dt", "soon"),
        ("config", {"attachments": "none"}),
        ("config", {}),
        ("digest", "0" * 64),
        ("format", 9),
    ],
)
def test_a_changed_side_file_is_refused(name, value, tmp_path) -> None:
    path = tmp_path / "m.npz"
    BaselineWeights.of(MODELS["tdpe"]).write(path)
    side = path.with_suffix(".json")
    side.write_text(json.dumps({**json.loads(side.read_text()), name: value}))
    with pytest.raises(FlywheelError):
        BaselineWeights.read(path, ROBOT)


def test_the_side_files_name_is_refused(tmp_path) -> None:
    with pytest.raises(ModelError, match="npz"):
        BaselineWeights.of(MODELS["arx"]).write(tmp_path / "m.json")
