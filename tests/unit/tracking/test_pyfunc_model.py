"""The model in the registry is the model that was trained: loaded from MLflow, the same numbers."""

import time

import numpy as np
import pytest

from flywheel.dynamics.gnn import ChunkNetwork, LearnedDynamics, NetworkConfig
from flywheel.errors import DataError
from flywheel.records import Observation, Past
from flywheel.results import GateDecision
from flywheel.runtime.tracking.mlflow_client import Board
from flywheel.runtime.tracking.pyfunc_model import PyfuncDynamics, read_model, write_model
from flywheel.runtime.tracking.tracker import TrackingConfig
from tests import draws


@pytest.fixture
def network(robot):
    return ChunkNetwork(robot, NetworkConfig.lean(width=8, rounds=1))


def windows(robot, history, batch=2, horizon=18):
    """A present with its past near the keyframe, and controls to come."""
    seed = draws.seed()
    rng = np.random.default_rng(seed)
    rest = np.stack([point.offset for point in robot.points]) + np.array([0.0, 0.0, 2.0])
    points = rest + rng.normal(0, 0.01, (batch, history + 1, len(robot.points), 3))
    winch = np.broadcast_to(
        np.array([robot.cables[w.cables[0]].rest_length for w in robot.winches]),
        (batch, history + 1, len(robot.winches)),
    ).copy()
    low, high = robot.control_low, robot.control_high
    past_controls = rng.uniform(low, high, (batch, history, len(low)))
    controls = rng.uniform(low, high, (batch, horizon, len(low)))
    inputs = {
        "points": points,
        "winch": winch,
        "past_controls": past_controls,
        "controls": controls,
    }
    past = Past(Observation(points, winch), past_controls, winch)
    return seed, inputs, past, controls


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*Any type hint is inferred as AnyType:UserWarning")
def test_the_champion_loaded_from_mlflow_predicts_what_the_network_predicts(
    tmp_path, robot, network
):
    digest = write_model(tmp_path / "model", robot, network, snapshot="s" * 64)
    board = Board(tmp_path, TrackingConfig(), "prism3")
    run = board.run("key", "name", {})
    shape = (len(robot.points), len(robot.winches))
    board.model(run, "model", "mppi-0000", digest, tmp_path / "model", shape, {})
    decision = GateDecision(promoted=True, measure="validation e_rot [deg]", number=3.25)
    board.promote(run, digest, decision)

    import mlflow

    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    mlflow.set_tracking_uri(uri)
    mlflow.set_registry_uri(uri)
    try:
        champion = mlflow.pyfunc.load_model("models:/flywheel-prism3@champion")
    finally:
        mlflow.set_tracking_uri(None)
        mlflow.set_registry_uri(None)
    learned = LearnedDynamics(robot, network)
    seed, inputs, past, controls = windows(robot, learned.history)
    got = champion.predict(inputs)
    wanted = learned.rollout(past, controls)
    np.testing.assert_array_equal(got["points"], wanted.points, err_msg=f"seed {seed}")
    np.testing.assert_array_equal(got["winch"], wanted.winch, err_msg=f"seed {seed}")
    assert got["points"].shape == (2, controls.shape[1] + 1, len(robot.points), 3)

    names = [tensor.name for tensor in champion.metadata.signature.inputs.inputs]
    assert names == list(inputs)
    with pytest.raises(mlflow.MlflowException, match="shape"):
        champion.predict(inputs | {"points": inputs["points"][:, :, 1:]})


def test_a_served_model_is_one_folder_and_says_what_it_misses(tmp_path, robot, network):
    digest = write_model(tmp_path / "a" / "model", robot, network)
    assert len(digest) == 64
    moved = (tmp_path / "a").rename(tmp_path / "b") / "model"
    served = PyfuncDynamics(read_model(moved))
    _, inputs, _, _ = windows(robot, served.dynamics.history)
    del inputs["winch"]
    with pytest.raises(DataError, match="winch"):
        served.predict(inputs)


def test_the_signature_does_not_depend_on_when_the_model_was_written(tmp_path, robot, network):
    first = write_model(tmp_path / "a", robot, network)
    time.sleep(0.01)
    assert write_model(tmp_path / "b", robot, network) == first
