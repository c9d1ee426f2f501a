"""The whole flywheel at smoke size, left in peace and tormented: the outcome is the same."""

import json
import os
import signal
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest
import yaml

from flywheel.data import TrajectoryStore
from flywheel.errors import ConfigError
from flywheel.results import RunResult
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.loop import run
from flywheel.runtime.pool.caretaker import MARK
from flywheel.runtime.pool.progress import Lines
from tests.chaos.killing import ROOT, kill, outcome, start_driver, wait_for

pytestmark = [pytest.mark.ray, pytest.mark.slow]
CONFIG = ROOT / "configs" / "smoke.yaml"
LONG = 600
# Not those of the run that was left in peace: who computes changes no number.
FEW_WORKERS = ("workers.sim=1", "workers.trainers=1")


def words_of(folder: Path) -> str:
    return folder.with_suffix(".log").read_text()


@pytest.fixture(scope="module")
def peaceful(plain_run, stranger):
    """What the README's run without a robot came to."""
    return stranger.folder / "runs" / "smoke"


@pytest.fixture(params=["first_run", pytest.param("plain_run", marks=pytest.mark.nightly)])
def finished(request, stranger):
    """The folder of each of the README's two runs."""
    request.getfixturevalue(request.param)
    return stranger.folder / "runs" / ("smoke" if request.param == "plain_run" else "smoke_robot")


@dataclass(frozen=True)
class Killed:
    """What a driver had that was killed in the middle of its first training.

    Attributes:
      folder: of its run.
      processes: below it.
      addresses: on which they listened.
      temporary: folders of Ray that they were marked with.
      filled: whether there was something in each.
    """

    folder: Path
    processes: list[psutil.Process]
    addresses: set[str]
    temporary: set[Path]
    filled: bool


@pytest.fixture(scope="module")
def killed(tmp_path_factory) -> Killed:
    folder = tmp_path_factory.mktemp("killed") / "run"
    driver = start_driver(CONFIG, folder, FEW_WORKERS)
    try:
        assert wait_for(driver, "trainer", LONG), words_of(folder)
        processes = psutil.Process(driver.pid).children(recursive=True)
        connections = [c for p in processes for c in p.net_connections() if c.status == "LISTEN"]
        temporary = {Path(each) for p in processes if (each := p.environ().get(MARK))}
        filled = all(any(each.iterdir()) for each in temporary)
    finally:
        driver.kill()
        driver.wait()
    addresses = {c.laddr.ip.removeprefix("::ffff:") for c in connections}
    return Killed(folder, processes, addresses, temporary, filled)


@pytest.mark.nightly
def test_a_run_produces_every_iteration_of_both_arms_and_what_it_is_compared_with(peaceful):
    result = RunResult.load(peaceful)
    assert result.finished
    done = [(i.iteration, i.arm) for i in result.iterations]
    assert done == [(0, "mppi"), (1, "mppi"), (1, "control"), (2, "mppi"), (2, "control")]
    assert len(result.pooled) == 5
    assert result.floor and result.persistence and result.oracle
    assert result.floor.short.windows == result.pooled[0].errors.short.windows > 0
    assert all(i.navigation is not None for i in result.iterations if i.arm == "mppi")


def test_every_model_names_the_snapshot_it_was_trained_on_and_snapshots_their_parents(finished):
    store = TrajectoryStore(finished / "store")
    result = RunResult.load(finished)
    for each in result.iterations:
        name = f"i{each.iteration:04d}-{each.arm}"
        about = json.loads((finished / "models" / name / "served" / "weights.json").read_text())
        snapshot = store.snapshot(name)
        assert about["digest"] == each.model
        assert about["snapshot"] == each.snapshot == snapshot.digest
        assert snapshot.parent == each.parent_snapshot
    assert store.verify() == ()


def test_no_test_episode_was_trained_on(finished):
    store = TrajectoryStore(finished / "store")
    tested = {e.id for e in store.snapshot("pooled-tests").episodes}
    for i in {each.iteration for each in RunResult.load(finished).iterations}:
        learned = store.snapshot(f"i{i:04d}-mppi").episodes
        assert not tested & {e.id for e in learned if e.split != "test"}
    assert {e.split for e in store.snapshot("pooled-tests").episodes} == {"test"}


@pytest.mark.nightly
def test_the_control_arm_trains_on_as_many_episodes_and_steps_of_the_optimiser(peaceful):
    results = {(i.iteration, i.arm): i for i in RunResult.load(peaceful).iterations}
    for i in (1, 2):
        mppi, control = results[i, "mppi"], results[i, "control"]
        assert mppi.episodes == control.episodes
        assert mppi.curve[-1].step == control.curve[-1].step


def test_a_finished_run_that_is_resumed_is_left_as_it_is(finished):
    before, said = (finished / "result.json").read_bytes(), []
    config = load_config(ROOT / "configs" / f"{finished.name}.yaml")
    run(config, finished, resume=True, tracked=False, progress=Lines(said.append))
    assert (finished / "result.json").read_bytes() == before
    assert said == [], "no stage was begun"


@pytest.mark.nightly
def test_nobody_else_is_let_in_and_nothing_is_left_of_a_killed_driver(killed):
    assert killed.addresses == {"127.0.0.1"}
    (folder,) = killed.temporary
    assert killed.filled
    psutil.wait_procs(killed.processes, timeout=30)
    left = [p for p in killed.processes if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]
    assert left == []
    assert not folder.exists(), "its caretaker is among the processes"


@pytest.mark.nightly
def test_a_tormented_run_comes_to_the_same_outcome(peaceful, killed):
    """Driver and trainer killed, second driver, Ctrl-C, another configuration."""
    folder = killed.folder
    driver = start_driver(CONFIG, folder, FEW_WORKERS)
    trainer = wait_for(driver, "trainer", LONG)
    assert trainer is not None and kill(trainer)
    os.kill(driver.pid, signal.SIGSTOP)  # or it could be done before the second has begun
    second = start_driver(CONFIG, folder)
    assert second.wait(LONG) == 1
    os.kill(driver.pid, signal.SIGCONT)
    assert f"is in use by process {driver.pid} on " in words_of(folder)

    assert wait_for(driver, "MPPI worker", LONG), "the killed trainer is replaced"
    os.killpg(driver.pid, signal.SIGINT)  # what a terminal does
    assert driver.wait(60) == 130, words_of(folder)
    assert "finished work is kept" in words_of(folder)

    with pytest.raises(ConfigError, match="mppi.samples: 8 -> 9"):
        run(load_config(CONFIG, ["mppi.samples=9"]), folder, resume=True, tracked=False)

    driver = start_driver(CONFIG, folder, (*FEW_WORKERS, "workers.cores=4"))
    assert driver.wait(LONG) == 0, words_of(folder)[-3000:]
    assert outcome(folder) == outcome(peaceful)


def test_the_configuration_is_stored_whole(finished):
    stored = yaml.safe_load((finished / "config.yaml").read_text())
    assert stored["mppi"]["samples"] == {"smoke": 8, "smoke_robot": 4}[finished.name]
    assert stored["training"]["weight_decay"] > 0, "defaults are stored, too"
