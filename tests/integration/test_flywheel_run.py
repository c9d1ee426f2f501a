"""The whole flywheel at smoke size, left in peace and tormented: the outcome is the same."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
from pathlib import Path

import psutil
import pytest
import yaml

from flywheel.data import TrajectoryStore
from flywheel.runtime.pool.caretaker import MARK
from flywheel.runtime.results import RunResult
from tests.chaos.killing import ROOT, kill, outcome, start_driver, wait_for

pytestmark = [pytest.mark.ray, pytest.mark.slow]
CONFIG = ROOT / "configs" / "smoke.yaml"
LONG = 600
OTHER_WORKERS = ("workers.sim=3", "workers.cores=4")


def words_of(folder: Path) -> str:
    return folder.with_suffix(".log").read_text()


def finish(folder: Path) -> None:
    driver = start_driver(CONFIG, folder)
    assert driver.wait(LONG) == 0, words_of(folder)[-3000:]


@pytest.fixture(scope="module")
def peaceful(first_run, stranger):
    """What the README's first command came to."""
    return stranger.folder / "runs" / "smoke"


@pytest.fixture
def begun(tmp_path):
    """A driver in the middle of its first training."""
    folder = tmp_path / "run"
    driver = start_driver(CONFIG, folder)
    assert wait_for(driver, "trainer", LONG), words_of(folder)
    yield driver, folder
    if driver.poll() is None:
        driver.kill()
        driver.wait()


def test_a_run_produces_every_iteration_of_both_arms_and_what_it_is_compared_with(peaceful):
    result = RunResult.load(peaceful)
    assert result.finished
    done = [(i.iteration, i.arm) for i in result.iterations]
    assert done == [(0, "mppi"), (1, "mppi"), (1, "control"), (2, "mppi"), (2, "control")]
    assert len(result.pooled) == 5
    assert result.floor and result.persistence and result.oracle
    assert result.floor.short.windows == result.pooled[0].errors.short.windows > 0
    assert all(i.navigation is not None for i in result.iterations if i.arm == "mppi")


def test_every_model_names_the_snapshot_it_was_trained_on_and_snapshots_their_parents(peaceful):
    store = TrajectoryStore(peaceful / "store")
    result = RunResult.load(peaceful)
    for each in result.iterations:
        name = f"i{each.iteration:04d}-{each.arm}"
        about = json.loads((peaceful / "models" / name / "served" / "weights.json").read_text())
        snapshot = store.snapshot(name)
        assert about["digest"] == each.model
        assert about["snapshot"] == each.snapshot == snapshot.digest
        assert snapshot.parent == each.parent_snapshot
    assert store.verify() == ()


def test_no_test_episode_was_trained_on(peaceful):
    store = TrajectoryStore(peaceful / "store")
    tested = {e.id for e in store.snapshot("pooled-tests").episodes}
    for i in range(3):
        learned = store.snapshot(f"i{i:04d}-mppi").episodes
        assert not tested & {e.id for e in learned if e.split != "test"}
    assert {e.split for e in store.snapshot("pooled-tests").episodes} == {"test"}


def test_the_control_arm_trains_on_as_many_episodes_and_steps_of_the_optimiser(peaceful):
    results = {(i.iteration, i.arm): i for i in RunResult.load(peaceful).iterations}
    for i in (1, 2):
        mppi, control = results[i, "mppi"], results[i, "control"]
        assert mppi.episodes == control.episodes
        assert mppi.curve[-1].step == control.curve[-1].step


def test_a_finished_run_that_is_resumed_is_left_as_it_is(peaceful):
    before = (peaceful / "result.json").read_bytes()
    finish(peaceful)
    assert (peaceful / "result.json").read_bytes() == before
    assert words_of(peaceful) == "", "no stage was begun"


def test_a_tormented_run_comes_to_the_same_outcome(peaceful, begun):
    """Trainer killed, second driver, Ctrl-C, SIGTERM, another configuration, driver killed twice."""
    driver, folder = begun
    trainer = wait_for(driver, "trainer", LONG)
    assert trainer is not None and kill(trainer)

    second = start_driver(CONFIG, folder)
    assert second.wait(LONG) == 1
    assert f"is in use by process {driver.pid} on " in words_of(folder)

    assert wait_for(driver, "trainer", LONG), "the killed trainer is replaced"
    os.killpg(driver.pid, signal.SIGINT)  # what a terminal does
    assert driver.wait(60) == 130, words_of(folder)
    assert "what is finished is kept" in words_of(folder)

    driver = start_driver(CONFIG, folder)
    assert wait_for(driver, "trainer", LONG)
    driver.terminate()  # what a container's runtime does
    assert driver.wait(60) == 130, words_of(folder)

    changed = start_driver(CONFIG, folder, ["mppi.samples=9"])
    assert changed.wait(LONG) == 1
    assert "mppi.samples: 8 -> 9" in words_of(folder)

    seed = random.randrange(2**32)
    rng = random.Random(seed)
    for _ in range(2):
        driver = start_driver(CONFIG, folder, OTHER_WORKERS)
        try:
            driver.wait(rng.uniform(8, 30))
            break
        except subprocess.TimeoutExpired:
            driver.kill()
            driver.wait()
    finish(folder)
    assert outcome(folder) == outcome(peaceful), f"seed {seed}"


def test_a_damaged_episode_that_is_sealed_stops_the_run_and_is_named(peaceful, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(peaceful, folder)
    (folder / "result.json").unlink()
    (folder / "iterations" / "i0002-mppi.json").unlink()
    shutil.rmtree(folder / "models" / "i0002-mppi")
    files = [p for p in (folder / "store/segments/i0000-random-0000").rglob("*") if p.is_file()]
    victim = max((p for p in files if ".zarr" in str(p)), key=lambda p: p.stat().st_size)
    data = bytearray(victim.read_bytes())
    data[len(data) // 2] ^= 1
    victim.write_bytes(data)
    driver = start_driver(CONFIG, folder)
    assert driver.wait(LONG) == 1
    assert "i0000-random-0000" in words_of(folder)


def test_the_configuration_is_stored_whole(peaceful):
    stored = yaml.safe_load((peaceful / "config.yaml").read_text())
    assert stored["mppi"]["samples"] == 8
    assert stored["training"]["weight_decay"] > 0, "defaults are stored, too"


def test_nobody_else_is_let_in_and_nothing_is_left_of_a_killed_driver(begun):
    driver, _ = begun
    processes = psutil.Process(driver.pid).children(recursive=True)
    listening = {c.laddr.ip for p in processes for c in p.net_connections() if c.status == "LISTEN"}
    assert {ip.removeprefix("::ffff:") for ip in listening} == {"127.0.0.1"}
    temporary = {Path(each) for p in processes if (each := p.environ().get(MARK))}
    (folder,) = temporary
    assert any(folder.iterdir())
    driver.kill()
    driver.wait()
    psutil.wait_procs(processes, timeout=30)
    assert [p for p in processes if p.is_running() and p.status() != psutil.STATUS_ZOMBIE] == []
    assert not folder.exists(), "its caretaker is among the processes"
