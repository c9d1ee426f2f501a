"""A robot with two cables on one motor goes through the loop, at its smallest size."""

from pathlib import Path

import numpy as np
import pytest

from flywheel.data import TrajectoryStore
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.loop import run
from tests.antagonists import antagonists
from tests.chaos.killing import ROOT

SMALL = (
    *("iterations=1", "control_arm=false", "collect.gaits=0", "collect.drops=0"),
    *("collect.random_seconds=1.0", "collect.mppi_seconds=1.0", "task.seconds=1.0"),
    *("evaluate.unseen=[]", "evaluate.tasks=1", "workers.sim=1", "workers.trainers=1"),
)


@pytest.mark.nightly
@pytest.mark.ray
@pytest.mark.slow
def test_one_motor_with_two_cables_is_learned_and_driven(tmp_path: Path) -> None:
    robot = antagonists()
    (tmp_path / "pair.xml").write_text(robot.xml)
    smoke = ROOT / "configs" / "smoke.yaml"
    config = load_config(smoke, [f"model={tmp_path}/pair.xml", *SMALL])
    result = run(config, tmp_path / "run", tracked=False)
    assert result.finished
    assert [(each.iteration, each.arm) for each in result.iterations] == [(0, "mppi"), (1, "mppi")]
    assert all(each.navigation is not None for each in result.iterations)
    assert all(np.isfinite(each.errors.short.e_pos_rmse) for each in result.pooled)
    store = TrajectoryStore(str(tmp_path / "run" / "store"))
    driven = [e.id for e in store.snapshot("i0001-mppi").episodes if "mppi" in e.id]
    assert driven
    for each in driven:
        controls = store.read(each).trajectory.controls
        assert controls.shape[-1] == len(robot.winches) == 1, "two cables, one command"
        assert np.ptp(controls) > 0
