"""A run on a GPU where there is none is refused at once; planners get device and precision."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.dynamics.arithmetic import Arithmetic
from flywheel.dynamics.gnn.shipped import shipped_weights
from flywheel.errors import ConfigError
from flywheel.robots import load_robot
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.workers.episode_plan import EpisodePlan
from flywheel.runtime.workers.model_weights import Weights
from flywheel.runtime.workers.robot_worker import RobotWorker
from flywheel.runtime.workers.sim_worker import SimWorker

SMOKE = Path(__file__).parents[3] / "configs" / "smoke.yaml"
PLAN = EpisodePlan("a", "mppi", iteration=0, split="test", seconds=0.1, seed=0, task_seed=0)


@pytest.fixture(autouse=True)
def _no_gpu(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)


@pytest.mark.parametrize("setting", ["training.device", "mppi.device"])
def test_a_run_on_a_gpu_that_is_not_there_is_bad_input_and_leaves_nothing(setting, tmp_path):
    given = ["run", str(SMOKE), f"{setting}=cuda", "--folder", str(tmp_path / "run")]
    done = CliRunner().invoke(app, given)
    assert done.exit_code == 2
    assert f"{setting}=cuda needs a CUDA GPU" in done.stderr
    assert f"{setting}=cpu" in done.stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("command", ["drive", "navigate"])
def test_planning_on_a_gpu_that_is_not_there_is_bad_input(command, tmp_path):
    given = [command, str(SMOKE), "--model", "shipped", "mppi.device=cuda"]
    done = CliRunner().invoke(app, given)
    assert done.exit_code == 2
    assert "mppi.device=cuda needs a CUDA GPU" in done.stderr


@pytest.mark.parametrize("kind", ["sim", "robot"])
def test_a_worker_plans_with_the_network_in_the_arithmetic_of_the_planner(
    kind, tmp_path, monkeypatch
):
    asked = []

    def refuse(weights, robot, threads, library, arithmetic):
        asked.append(arithmetic)
        raise ConfigError("that is all")

    config = load_config(
        SMOKE,
        ["mppi.device=cuda", "mppi.precision=bfloat16", "robot.link=simulated", "collect.gaits=0"],
    )
    robot, store = load_robot(config.model), str(tmp_path / "store")
    worker = (
        SimWorker(config, store, robot)
        if kind == "sim"
        else RobotWorker(config, store, robot, tmp_path)
    )
    weights = Weights.read(shipped_weights(robot), robot)
    with pytest.raises(ConfigError, match="device=cuda needs a CUDA GPU"):
        worker.record(PLAN, weights)
    monkeypatch.setattr(Weights, "dynamics", refuse)
    with pytest.raises(ConfigError, match="that is all"):
        worker.record(PLAN, weights)
    assert asked == [Arithmetic("cuda", "bfloat16")]
