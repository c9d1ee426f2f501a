"""A run on a robot that is not its model, on local Ray: found, driven, and in MLflow under fixed names."""

from pathlib import Path

import pytest

from flywheel.data import TrajectoryStore
from flywheel.results import RunResult
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.loop import run
from flywheel.runtime.tracking.dashboard import DATABASE
from flywheel.runtime.workers.stored_episodes import effects_of
from tests.conftest import ROOT, Stranger

pytestmark = [pytest.mark.ray, pytest.mark.slow]


@pytest.fixture(scope="module")
def folder(first_run: object, stranger: Stranger) -> Path:
    """What the README's first command came to."""
    return stranger.folder / "runs" / "smoke_robot"


def test_what_the_robot_has_is_found_and_the_plant_predicts_it_better(folder: Path) -> None:
    result = RunResult.load(folder)
    first, last = (iteration.robot for iteration in result.iterations)
    note = result.iterations[1].diagnosis
    assert first is not None and last is not None and note is not None
    assert note.adopted and [effect.effect for effect in note.effects] == ["torque_speed"]
    assert first.errors["plant"] == first.errors["given"], "nothing was adopted yet"
    assert last.errors["plant"].short.e_pos_rmse < 0.7 * last.errors["given"].short.e_pos_rmse
    assert (
        last.noise is not None and 0 < last.noise.e_pos_rmse < last.errors["plant"].short.e_pos_rmse
    )
    for robot in (first, last):
        assert {name: len(each.walks) for name, each in robot.drives.items()} == {
            "network": 1, "plant": 1,
        }  # fmt: skip
    assert first.minutes == pytest.approx(3 * 1.6 / 60)
    assert last.minutes == pytest.approx(first.minutes + first.driven_minutes)
    assert {(score.iteration, score.model) for score in result.on_robot} == {
        (0, "given"), (0, "plant"), (0, "network"), (1, "plant"), (1, "network"),
    }  # fmt: skip


def test_data_are_simulated_anew_on_the_plant_that_has_what_was_found(folder):
    store, result = TrajectoryStore(folder / "store"), RunResult.load(folder)
    found = result.iterations[1].diagnosis.effects
    for number, effects in ((0, ()), (1, found)):
        episodes = store.snapshot(f"i000{number}-mppi").episodes
        made = [episode.id for episode in episodes if episode.source == "sim"]
        assert made and all(name.startswith(f"i000{number}-") for name in made)
        assert {effects_of(store.read(name)) for name in made} == {effects}
        judged = result.iterations[number].test.by_episode
        assert judged and all(effects_of(store.read(name)) == effects for name in judged)


@pytest.mark.renders
def test_each_iteration_has_a_video_of_the_robot_as_it_was_measured(folder: Path) -> None:
    for iteration in RunResult.load(folder).iterations:
        assert (folder / iteration.video).stat().st_size > 10_000
        assert iteration.robot is not None and iteration.robot.filmed in iteration.robot.drives
    assert "as measured, MPPI on model" in (folder / "report.html").read_text()


def test_what_the_robot_measured_are_recordings_that_the_next_network_learns_from(folder):
    store = TrajectoryStore(folder / "store")
    ids = [name for name in store.committed() if "-robot-" in name]
    assert len(ids) == 3 + 2 * 2
    for episode in map(store.read, ids):
        assert episode.trajectory.states is None and episode.provenance.source == "recording"
        assert episode.provenance.dataset == "recording" and episode.provenance.effects == {}
    learned = {e.id for e in store.snapshot("i0001-mppi").episodes}
    assert {name for name in ids if name.startswith("i0000")} <= learned
    assert {e.id for e in store.snapshot("i0000-mppi").episodes} >= {
        name for name in ids if "-first-" in name
    }


def test_mlflow_has_the_robot_under_fixed_names_and_the_page_of_the_diagnosis(folder: Path) -> None:
    uri = f"sqlite:///{folder / DATABASE}"
    from mlflow import MlflowClient  # slow to import

    client = MlflowClient(tracking_uri=uri, registry_uri=uri)
    runs = [r for e in client.search_experiments() for r in client.search_runs([e.experiment_id])]
    (whole,) = [r for r in runs if r.data.tags.get("flywheel.kind") == "run"]
    for name in (
        "robot/error_0.5s/given",
        "robot/error_0.5s/plant",
        "robot/error_0.5s/network",
        "robot/error_of_noise",
        "robot/success/network",
        "robot/success/plant",
        "robot/minutes",
        "robot_pooled/error_0.5s/plant",
    ):
        steps = {point.step for point in client.get_metric_history(whole.info.run_id, name)}
        assert steps == {0, 1}, name
    assert "robot/minutes_to_best/plant" in whole.data.metrics
    (second,) = [r for r in runs if r.data.tags.get("flywheel.iteration") == "1"]
    pages = [file.path for file in client.list_artifacts(second.info.run_id)]
    assert any(path.endswith("i0001-diagnosis.html") for path in pages), pages


def test_nothing_is_driven_again_when_the_run_is_resumed(folder: Path, local_ray: object) -> None:
    before = {path: path.stat().st_mtime_ns for path in (folder / "robot").glob("*.jsonl")}
    models = [iteration.model for iteration in RunResult.load(folder).iterations]
    (folder / "iterations" / "i0001-mppi.json").unlink()
    (folder / "result.json").unlink()
    again = run(load_config(ROOT / "configs" / "smoke_robot.yaml"), folder, resume=True)
    assert [iteration.model for iteration in again.iterations] == models
    assert {path: path.stat().st_mtime_ns for path in (folder / "robot").glob("*.jsonl")} == before
