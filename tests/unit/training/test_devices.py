"""Training on another device than the processor: the same numbers, and no tensor is left behind."""

import numpy as np
import pytest

from flywheel.dynamics.gnn import load_weights
from flywheel.errors import ConfigError
from flywheel.training import Trainer, trainer
from tests.other_device import OTHER, OtherDevice


def test_a_training_on_another_device_ends_with_the_weights_of_the_processors(
    robot, train, validation, network_config, make_config, tmp_path, monkeypatch
):
    config = make_config(steps=4, precision="float32", validate_every=4)
    parts = network_config, robot, train, validation
    here = Trainer(config, *parts, tmp_path / "here").run()
    monkeypatch.setattr(
        trainer, "write_checkpoint", lambda *_: None
    )  # torch stores real tensors only
    with OtherDevice():
        elsewhere = config.model_copy(update={"device": OTHER})
        there = Trainer(elsewhere, *parts, tmp_path / "there").run()
    assert there.best_error == pytest.approx(here.best_error, rel=1e-3)
    one, two = (load_weights(done.weights, robot).state_dict() for done in (here, there))
    for name in one:
        np.testing.assert_allclose(two[name], one[name], rtol=0, atol=1e-3)


def test_a_training_on_a_gpu_that_is_not_there_is_refused(
    robot, train, validation, network_config, make_config, tmp_path, monkeypatch
):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(ConfigError, match=r"training\.device=cuda needs .* training\.device=cpu"):
        Trainer(make_config(device="cuda"), network_config, robot, train, validation, tmp_path)
    assert not list(tmp_path.iterdir())
