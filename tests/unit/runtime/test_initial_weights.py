"""Weights that a run begins with: checked before anything starts, kept in its folder, trained on."""

from pathlib import Path
from typing import Any

import pytest

from flywheel.dynamics.gnn import (
    ChunkNetwork,
    NetworkConfig,
    load_weights,
    save_weights,
    seeing,
    weights_digest,
)
from flywheel.errors import ConfigError, DataError
from flywheel.robots import load_robot
from flywheel.runtime.config.run_config import RunConfig, config_digest
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.run.inventory import Inventory
from flywheel.runtime.run.suitability import check_suits
from tests.unit.runtime.tiny_run import TINY, Bench

ROBOT = load_robot("prism3")


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    path = tmp_path / "given.npz"
    save_weights(ChunkNetwork(ROBOT, NetworkConfig(**TINY["network"])), path)
    return path


def training(source: str | Path) -> dict[str, Any]:
    return {**TINY["training"], "from": str(source)}


@pytest.mark.slow
def test_the_first_training_begins_with_the_weights_and_the_run_keeps_a_copy(weights, tmp_path):
    slow = {**TINY["training"]["fine_tuning"], "learning_rate": 1e-9}
    given = {**training(weights), "fine_tuning": slow}
    bench = Bench(tmp_path / "run", training=given, iterations=0)
    bench.files.path.mkdir()
    bench.turn()
    first = load_weights(weights, ROBOT).state_dict()
    trained = load_weights(bench.files.weights(0, "mppi"), ROBOT).state_dict()
    for name, value in trained.items():
        if not name.startswith("normalisers."):  # which may be widened
            assert (value - first[name]).abs().max() < 1e-6, name

    weights.unlink()  # the run has its own
    assert bench.files.begin(bench.config, resume=True).key == bench.files.begun().identity.key
    assert bench.files.initial_weights is not None
    inventory = Inventory(bench.files, bench.store)
    assert not inventory.strangers() and not list(inventory.faults())


def test_a_copy_that_was_changed_is_refused(weights: Path, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.path.mkdir()
    config = RunConfig.model_validate({**TINY, "training": training(weights)})
    folder.begin(config, resume=False)
    for name in ("initial.npz", "initial.json"):
        path = folder.path / name
        sound = path.read_bytes()
        path.write_bytes(sound[:-1])
        with pytest.raises(DataError, match=f"{name}.*Restore a copy of it"):
            folder.begin(config, resume=True)
        path.write_bytes(sound)


def test_the_weights_of_another_network_are_refused_with_what_would_make_it_the_same(weights):
    config = RunConfig.model_validate({"training": {"from": str(weights)}})
    with pytest.raises(ConfigError) as caught:
        check_suits(config, ROBOT)
    said = str(caught.value)
    assert said.endswith("To leave these out: training.from=")
    overrides = [word for word in said.split() if word.startswith("network.")]
    assert {word.partition("=")[0] for word in overrides} == {
        f"network.{k}" for k in TINY["network"]
    }
    assert "network.width=8" in overrides


@pytest.mark.slow
def test_weights_of_a_network_that_sees_the_ground_alone_begin_one_that_sees_boxes(
    weights, tmp_path
):
    """The edges to all surfaces share their weights; what comes of it sees boxes."""
    network = {**TINY["network"], "surfaces": 3}
    bench = Bench(tmp_path / "run", network=network, training=training(weights), iterations=0)
    bench.files.path.mkdir()
    bench.turn()
    trained = load_weights(bench.files.weights(0, "mppi"), ROBOT)
    assert trained.config.surfaces == 3
    first = load_weights(weights, ROBOT)
    assert first.config.surfaces == 1
    for name, value in first.state_dict().items():
        assert value.shape == trained.state_dict()[name].shape, name
    assert weights_digest(seeing(first, ROBOT, 3)) != weights_digest(first)
    assert weights_digest(seeing(seeing(first, ROBOT, 3), ROBOT, 1)) == weights_digest(first)


def test_weights_that_are_not_there_or_of_another_robot_are_refused(weights, tmp_path):
    with pytest.raises(ConfigError, match="There are no weights at .*nowhere"):
        check_suits(RunConfig.model_validate({"training": {"from": "nowhere.npz"}}), ROBOT)
    six = RunConfig.model_validate({**TINY, "model": "icosa6", "training": training(weights)})
    with pytest.raises(ConfigError, match="trained for another robot"):
        check_suits(six, load_robot("icosa6"))
    mine = RunConfig.model_validate({**TINY, "model": "platform4", "training": training("shipped")})
    with pytest.raises(ConfigError, match="No network for platform4 .* prism3"):
        check_suits(mine, load_robot("platform4"))


def test_weights_to_begin_with_decide_the_results(weights: Path) -> None:
    given = RunConfig.model_validate({"training": {"from": str(weights)}})
    assert config_digest(RunConfig()) != config_digest(given)


def test_an_unknown_key_of_the_training_is_told_how_it_is_written() -> None:
    with pytest.raises(ValueError, match="frm"):
        RunConfig.model_validate({"training": {"frm": "shipped"}})
