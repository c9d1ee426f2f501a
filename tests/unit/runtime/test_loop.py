"""The loop on the real plant, store, network and planner, with workers in this process."""

import dataclasses
import json
import math
import socket
import subprocess
from collections import Counter

import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import load_weights, save_weights
from flywheel.errors import DataError, ModelError, RunError
from flywheel.robots import load_robot
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.loop import run
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.runtime.workers.sim_worker import Baseline, SimWorker
from flywheel.runtime.workers.trainer_worker import TrainerWorker
from tests.damage import flip
from tests.unit.runtime.tiny_run import TINY, Bench

pytestmark = pytest.mark.slow


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


def fail_at(monkeypatch, *marks: str, error: Exception | None = None) -> None:
    """Let the recording of episodes whose id contains a mark fail."""
    honest = EpisodeRecorder.record

    def record(self, plan, *arguments):
        if any(mark in plan.id for mark in marks):
            raise error or ModelError(f"{plan.id}: simulation 0 diverged at 0.4 s")
        return honest(self, plan, *arguments)

    monkeypatch.setattr(EpisodeRecorder, "record", record)


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """A run, and what it came to."""
    bench = Bench(tmp_path_factory.mktemp("turned"))
    return bench, bench.turn()


def test_a_run_turns_from_an_empty_folder_to_its_conclusion(turned):
    _, result = turned
    assert result.finished and [i.iteration for i in result.iterations] == [0, 1]
    first, second = result.iterations
    assert first.gate.promoted and first.gate.reference is None
    assert second.parent_snapshot == first.snapshot
    assert (first.episodes, second.episodes) == (3, 5)
    assert result.oracle.success.total == 1
    assert {p.iteration for p in result.pooled} == {0, 1}
    assert all(math.isfinite(p.errors.short.e_rot) for p in result.pooled)


def test_episodes_collected_in_a_later_iteration_are_planned_with_the_champions_weights(turned):
    bench, result = turned
    for episode in bench.store.snapshot("i0001-mppi").episodes:
        expected = result.iterations[0].model if episode.iteration == 1 else ""
        assert episode.model == expected
        assert episode.controller == ("mppi" if episode.iteration == 1 else "random")


def test_an_interrupted_run_records_only_what_is_missing(bench, monkeypatch):
    stop = RunError("stopped on purpose")
    with monkeypatch.context() as patch:
        fail_at(patch, "i0001-mppi-collect-0001", error=stop)
        with pytest.raises(RunError, match="on purpose"):
            bench.turn()
    dead = subprocess.Popen(["true"])
    dead.wait()
    unfinished = bench.files.path / "store" / "tmp" / f"{socket.gethostname()}+{dead.pid}+x"
    unfinished.mkdir()
    recorded = Counter[str]()
    honest = EpisodeRecorder.record

    def record(self, plan, *arguments):
        recorded[plan.id] += 1
        return honest(self, plan, *arguments)

    monkeypatch.setattr(EpisodeRecorder, "record", record)
    assert bench.turn(resume=True).finished
    assert recorded == {"i0001-mppi-collect-0001": 1, "i0001-mppi-evaluate-0000": 1}
    assert not unfinished.exists(), "of a worker that was killed"


def test_an_episode_whose_plant_diverges_is_not_stored_but_counted_and_told(bench, monkeypatch):
    fail_at(monkeypatch, "i0001-mppi-collect-0000")
    result = bench.turn()
    assert result.iterations[1].invalid == 1
    assert result.iterations[1].new_episodes == 1
    assert "i0001-mppi-collect-0000" not in bench.store.committed()
    assert any("discarded" in note and "diverged at 0.4 s" in note for note in result.notes)
    assert any("discarded" in line for line in bench.said)


def test_too_few_valid_episodes_end_the_run_with_the_numbers(bench, monkeypatch):
    fail_at(monkeypatch, "collect-0000", "collect-0001")
    with pytest.raises(
        RunError,
        match="Only 0 of 2 episodes of iteration 1.*0001 was discarded: .*diverged at 0.4 s",
    ):
        bench.turn()


def test_a_model_that_predicts_no_numbers_is_rejected_and_the_champion_kept(bench, monkeypatch):
    def poisoned(self, *how):
        dynamics = honest(self, *how)
        if self.digest == bad[0]:
            monkeypatch.setattr(
                dynamics, "rollout", lambda *a: (_ for _ in ()).throw(ModelError("NaN"))
            )
        return dynamics

    from flywheel.runtime.workers.model_weights import Weights

    honest = Weights.dynamics
    bad = [""]
    monkeypatch.setattr(Weights, "dynamics", poisoned)
    first_training = TrainerWorker.train

    def train(self, order):
        note = first_training(self, order)
        if order.snapshot != "i0001-mppi":
            return note
        network = load_weights(note.weights, load_robot("prism3"))
        with torch.no_grad():  # two steps may have bettered nothing: make it another model
            next(network.parameters()).add_(1e-3)
        bad[0] = save_weights(network, note.weights)
        return dataclasses.replace(note, digest=bad[0])

    monkeypatch.setattr(TrainerWorker, "train", train)
    result = bench.turn()
    second = result.iterations[1]
    assert not second.gate.promoted and "finite" in second.gate.reason
    assert second.navigation is None and math.isnan(second.validation.short.e_rot)
    assert [p.iteration for p in result.pooled] == [0]
    assert json.loads((bench.files.path / "result.json").read_text())["finished"]


def test_a_training_that_diverges_leaves_the_champion_and_goes_on(bench, monkeypatch):
    from flywheel.runtime.workers.trainer_worker import TrainingNote

    honest = TrainerWorker.train

    def train(self, order):
        if order.snapshot == "i0001-mppi":
            return TrainingNote(problem="Training step 3: the loss is nan")
        return honest(self, order)

    monkeypatch.setattr(TrainerWorker, "train", train)
    result = bench.turn()
    assert result.finished and not result.iterations[1].gate.promoted
    assert any("the loss is nan" in note for note in result.notes)


def test_a_first_training_that_diverges_ends_the_run(bench, monkeypatch):
    from flywheel.runtime.workers.trainer_worker import TrainingNote

    monkeypatch.setattr(TrainerWorker, "train", lambda self, order: TrainingNote(problem="nan"))
    with pytest.raises(RunError, match="there is no model: nan"):
        bench.turn()


def damage(bench, name: str, part: str) -> None:
    """Flip a bit of the largest file of an episode's segment whose path has such a part."""
    files = [p for p in bench.files.path.rglob("*") if name in str(p) and part in str(p)]
    flip(max((p for p in files if p.is_file()), key=lambda p: p.stat().st_size))


@pytest.mark.parametrize("part", [pytest.param(".zarr", marks=pytest.mark.nightly), "receipt.json"])
def test_a_damaged_episode_that_nothing_builds_on_is_set_aside_and_recorded_again(
    bench, monkeypatch, part
):
    with monkeypatch.context() as patch:
        fail_at(patch, "i0000-random-0004", error=RunError("stop"))
        with pytest.raises(RunError):
            bench.turn()
    name = "i0000-random-0001"
    damage(bench, name, part)
    assert bench.turn(resume=True).finished
    assert [q for q in bench.store.quarantined() if q.startswith(name)]
    assert not bench.store.verify()


def test_a_damaged_episode_that_is_sealed_stops_the_run_and_is_named(bench, monkeypatch):
    with monkeypatch.context() as patch:
        fail_at(patch, "i0001-mppi-collect-0001", error=RunError("stop"))
        with pytest.raises(RunError):
            bench.turn()
    name = "i0000-random-0000"
    damage(bench, name, ".zarr")
    with pytest.raises(DataError, match=name):
        bench.turn(resume=True)


def test_a_full_disk_is_told_as_such(bench, monkeypatch):
    fail_at(monkeypatch, "random-0002", error=OSError(28, "No space left on device"))
    with pytest.raises(RunError, match=r"The disk is full.*--resume"):
        bench.turn()


def test_two_runs_of_one_configuration_agree_to_the_bit_and_another_seed_does_not(tmp_path):
    one, two, other = (
        Bench(tmp_path / name, seed=seed, iterations=0).digests()
        for name, seed in (("a", 3), ("b", 3), ("c", 4))
    )
    assert one == two
    assert one != other


def test_measurement_noise_reaches_what_is_stored(tmp_path):
    bench = Bench(tmp_path, iterations=0, measurement={"noise": 0.01})
    bench.turn()
    episode = bench.store.read("i0000-random-0000")
    recorder = EpisodeRecorder(bench.config, load_robot(bench.config.model))
    truth = recorder.plant(0).observe(episode.trajectory.states).points
    spread = np.std(episode.trajectory.observations.points - truth)
    assert spread == pytest.approx(0.01 * recorder.robot.length, rel=0.1)


def test_predictions_are_judged_by_what_happened_not_by_what_was_measured(tmp_path):
    bench = Bench(tmp_path, iterations=0, measurement={"noise": 0.05})
    bench.turn()
    names = [e.id for e in bench.store.snapshot("i0000-mppi").episodes]
    robot = load_robot(bench.config.model)
    worker = SimWorker(bench.config, bench.files.store_url(bench.config), robot)
    informed = worker.score(Baseline.INFORMED_FLOOR, names, 0, False).short
    noisy = RunConfig.model_validate({**bench.config.model_dump(), "measurement": {}})
    measured = SimWorker(noisy, bench.files.store_url(bench.config), robot)
    blurred = measured.score(Baseline.INFORMED_FLOOR, names, 0, False).short
    noise_of_a_centre = 100 * 0.05 / np.sqrt(2)  # of two caps [% of L]
    expected = np.hypot(informed.e_pos_rmse, np.sqrt(3) * noise_of_a_centre)
    assert blurred.e_pos_rmse == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(
    ("store", "says"),
    [("ftp://here/x", "a folder or at s3://bucket/prefix"), ("s3://", "Bucket ''")],
)
def test_a_run_whose_store_is_nowhere_leaves_nothing(tmp_path, store, says):
    config = RunConfig.model_validate({**TINY, "store": store})
    with pytest.raises(DataError, match=says):
        run(config, tmp_path / "run", tracked=False)
    assert not any(tmp_path.iterdir())
