"""Against the real MLflow: SQLite, a dead port, a server that hangs, a server that comes back."""

import contextlib
import logging
import math
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request

import pytest

from flywheel.results import GateDecision, RunResult
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.run.publish import Page
from flywheel.runtime.tracking.dashboard import ui_command
from flywheel.runtime.tracking.mlflow_client import Board
from flywheel.runtime.tracking.tracker import Tracker, TrackingConfig
from tests.full_disk import complaints, files_end_at
from tests.unit.reports.fake_run import fake_run

pytestmark = pytest.mark.slow

FAST = (0.05, 0.5)


def written(folder, run):
    """The files of a run that are published."""
    for each in run.iterations:
        weights = RunFolder(folder).weights(each.iteration, each.arm)
        weights.parent.mkdir(parents=True, exist_ok=True)
        weights.write_text("weights")
    for name in ("report.html", *(each.video for each in (*run.iterations, *run.unseen))):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if name:
            (folder / name).write_text("file")
    return folder


def board_of(folder, config=TrackingConfig()):
    folder.mkdir(parents=True, exist_ok=True)
    return Board(folder, config, "prism3")


def tracker_of(folder, config=TrackingConfig(), board=Board):
    folder.mkdir(parents=True, exist_ok=True)
    page = Page(board(folder, config, "prism3"), RunFolder(folder), (6, 6))
    return Tracker(page.publish, FAST)


def contents(uri):
    """Everything MLflow holds that a replay could double."""
    from mlflow import MlflowClient

    client = MlflowClient(tracking_uri=uri, registry_uri=uri)
    experiment = client.get_experiment_by_name("flywheel").experiment_id
    held = {}
    for run in client.search_runs([experiment]):
        key = run.data.tags["flywheel.run_key"]
        assert key not in held, "a run was opened twice"
        histories = {
            name: sorted(
                (m.step, m.value) for m in client.get_metric_history(run.info.run_id, name)
            )
            for name in run.data.metrics
        }
        held[key] = {
            "status": run.info.status,
            "metrics": histories,
            "params": run.data.params,
            "snapshots": [i.dataset.digest for i in run.inputs.dataset_inputs],
            "models": len(run.outputs.model_outputs) if run.outputs else 0,
            "files": [a.path for a in client.list_artifacts(run.info.run_id)],
            "parent": run.data.tags.get("mlflow.parentRunId", "") != "",
            "snapshot": run.data.tags.get("flywheel.snapshot"),
            "tags": run.data.tags,
        }
    name = "flywheel-prism3"
    versions = client.search_model_versions(f"name = '{name}'")
    held["registry"] = sorted(v.tags["flywheel.model"] for v in versions)
    if versions:
        champion = client.get_model_version_by_alias(name, "champion")
        held["champion"] = {
            "model": champion.tags["flywheel.model"],
            "number": champion.tags["flywheel.gate.number"],
        }
    return held


def check(held, run):
    """What MLflow holds is what the run was, once."""
    key = run.key
    parent = held[key]
    assert parent["status"] == "FINISHED"
    assert parent["metrics"]["closed_loop/success_rate"] == [
        (i.iteration, i.navigation.success.rate) for i in run.of_arm("mppi")
    ]
    assert parent["metrics"]["error_pooled/short_e_rot_deg"] == [
        (i.iteration, i.test.short.e_rot) for i in run.of_arm("mppi")
    ]
    assert parent["params"]["mppi.samples"] == "64"
    assert "report.html" in parent["files"]
    for iteration in run.iterations:
        child = held[f"{key}/{iteration.arm}-{iteration.iteration:04d}"]
        assert child["parent"]
        assert child["status"] == "FINISHED"
        assert child["snapshots"] == [iteration.snapshot[:36]]
        assert child["snapshot"] == iteration.snapshot
        assert len(child["metrics"]["training/loss"]) == len(iteration.curve)
        assert child["models"] == 1
    assert held["registry"] == sorted(i.model for i in run.iterations)
    best = [i for i in run.of_arm("mppi") if i.gate.promoted][-1]
    assert held["champion"] == {"model": best.model, "number": str(best.gate.number)}


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


@contextlib.contextmanager
def mlflow_server(folder, port):
    """What `flywheel ui` starts, on an empty folder, until the end of the block."""
    folder.mkdir()
    command, environment, _ = ui_command(folder, port)
    with (folder / "log").open("w") as log:
        server = subprocess.Popen(
            command,
            cwd=folder,
            stdout=log,
            stderr=log,
            env=os.environ | environment,
            start_new_session=True,
        )
    try:
        wait_for(f"http://127.0.0.1:{port}/health", server, folder / "log")
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(server.pid, 15)
        server.wait(60)


def wait_for(url, server, log, seconds=180):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        assert server.poll() is None, log.read_text()[-2000:]
        with contextlib.suppress(OSError), urllib.request.urlopen(url, timeout=1):
            return
        time.sleep(0.2)
    raise AssertionError(log.read_text()[-2000:])


def first_problem(tracker, seconds=90):
    """Why delivery fails, once it does."""
    deadline = time.monotonic() + seconds
    while not tracker.problem:
        assert time.monotonic() < deadline, "delivery did not fail"
        time.sleep(0.02)
    return tracker.problem


@pytest.fixture(scope="module")
def run():
    return fake_run(iterations=2)


def test_a_run_lands_in_its_own_sqlite_file_once_however_often_it_is_delivered(tmp_path, run):
    class Breaks(Board):
        """Does everything, loses MLflow's answer now and then, and so everything is done again."""

        calls = 0

        def log(self, run, rows, since=None):
            super().log(run, rows, since)
            Breaks.calls += 1
            if Breaks.calls in (2, 6):
                raise ConnectionError("the answer was lost")

    folder = written(tmp_path, run)
    tracker = tracker_of(folder, board=Breaks)
    tracker.show(run)
    assert tracker.close(120), tracker.problem
    held = contents(f"sqlite:///{tmp_path / 'mlflow.db'}")
    check(held, run)

    (folder / "published.txt").unlink()
    again = tracker_of(folder)
    again.show(run)
    assert again.close(120), again.problem
    assert contents(f"sqlite:///{tmp_path / 'mlflow.db'}") == held


def test_a_killed_run_is_reopened_and_ends_as_finished(tmp_path):
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    states = []
    for finished in (False, True):
        tracker = tracker_of(tmp_path)
        tracker.show(RunResult(name="name", key="key"))
        assert tracker.flush(120), tracker.problem
        states.append(contents(uri)["key"]["status"])
        if finished:
            tracker.show(RunResult(name="name", key="key", finished=True))
        else:
            tracker.end("KILLED")
        assert tracker.close(120), tracker.problem
        states.append(contents(uri)["key"]["status"])
    assert states == ["RUNNING", "KILLED", "RUNNING", "FINISHED"]


@pytest.mark.nightly
def test_a_dead_server_delays_no_call_and_gets_everything_once_when_it_comes_up(tmp_path, run):
    port = free_port()
    folder = written(tmp_path / "run", run)
    config = TrackingConfig(uri=f"http://127.0.0.1:{port}", request_seconds=2)
    tracker = tracker_of(folder, config)
    start = time.monotonic()
    tracker.show(run)
    assert time.monotonic() - start < 1
    assert "refused" in first_problem(tracker)
    assert not tracker.close(0.1)
    with mlflow_server(tmp_path / "server", port):
        for _ in range(2):  # what a resumed run publishes again changes nothing
            later = tracker_of(folder, config)
            later.show(run)
            assert later.close(120), later.problem
            check(contents(config.uri), run)
            (folder / "published.txt").unlink()


def test_a_server_that_accepts_and_never_answers_blocks_nobody(tmp_path, run):
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen(16)
        config = TrackingConfig(
            uri=f"http://127.0.0.1:{listener.getsockname()[1]}", request_seconds=1
        )
        tracker = tracker_of(tmp_path, config)
        start = time.monotonic()
        tracker.show(run)
        assert time.monotonic() - start < 1
        assert "timed out" in first_problem(tracker)
        start = time.monotonic()
        assert not tracker.close(0.5)
        assert time.monotonic() - start < 3


def test_the_database_is_whole_even_if_another_process_makes_it_at_the_same_time(tmp_path):
    script = (
        "import sys; from pathlib import Path; from flywheel.runtime.tracking import mlflow_client;"
        "mlflow_client._configure(5); mlflow_client._make_database(Path(sys.argv[1]) / 'mlflow.db')"
    )
    with subprocess.Popen([sys.executable, "-c", script, str(tmp_path)]) as other:
        board_of(tmp_path).run("key", "name", {})
        assert other.wait(180) == 0
    assert contents(f"sqlite:///{tmp_path / 'mlflow.db'}")["key"]["status"] == "RUNNING"
    assert sorted(path.name for path in tmp_path.glob("*mlflow*")) == ["mlflow.db"]


def test_a_database_that_was_lost_is_made_anew_and_told_everything(tmp_path, run):
    original = written(tmp_path / "run", run)
    tracker = tracker_of(original)
    tracker.show(run)
    assert tracker.close(120), tracker.problem
    for name in ("removed", "emptied"):  # a copy: MLflow keeps the files it knows open
        folder = tmp_path / name
        shutil.copytree(original, folder)
        (folder / "mlflow.db").unlink()
        if name == "emptied":
            (folder / "mlflow.db").touch()
        again = tracker_of(folder)
        again.show(run)
        assert again.close(120), again.problem
        check(contents(f"sqlite:///{folder / 'mlflow.db'}"), run)


def test_a_damaged_database_delays_nobody_and_is_told_in_one_line(tmp_path, caplog, capfd):
    for damaged in (b"no database", bytes(8192)):
        (tmp_path / "mlflow.db").write_bytes(damaged)
        tracker = tracker_of(tmp_path)
        tracker.show(RunResult(name="name", key="key"))
        assert "is damaged" in first_problem(tracker)
        start = time.monotonic()
        assert not tracker.close(60)
        assert time.monotonic() - start < 10
    assert [record.levelname for record in caplog.records] == ["WARNING", "WARNING"]
    assert "--resume makes a new one" in caplog.text
    assert capfd.readouterr().err == ""
    (tmp_path / "mlflow.db").unlink()  # moved away: nothing was lost
    later = tracker_of(tmp_path)
    later.show(RunResult(name="name", key="key"))
    assert later.close(120), later.problem
    assert contents(f"sqlite:///{tmp_path / 'mlflow.db'}")["key"]["status"] == "RUNNING"


def test_a_disk_that_fills_up_while_the_database_is_used_is_told_in_one_line(
    tmp_path, run, caplog, capfd
):
    # As it is unless another test imported MLflow before a tracker could tell it to be quiet.
    caplog.set_level(logging.CRITICAL, logger="mlflow")
    caplog.handler.setLevel(logging.NOTSET)
    folder = written(tmp_path, run)
    tracker = tracker_of(folder)
    tracker.show(RunResult(name=run.name, key=run.key))
    assert tracker.flush(120), tracker.problem
    with files_end_at((tmp_path / "mlflow.db").stat().st_size):
        tracker.show(run)
        assert first_problem(tracker)
        assert not tracker.close(0.5)
    ours = [record for record in caplog.records if record.name.startswith("flywheel")]
    assert len(ours) == 1, caplog.text
    assert complaints(capfd) == []
    later = tracker_of(folder)
    later.show(run)
    assert later.close(120), later.problem
    check(contents(f"sqlite:///{tmp_path / 'mlflow.db'}"), run)


@pytest.mark.parametrize("odd", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_becomes_a_tag_and_a_health_warning(tmp_path, odd):
    board = board_of(tmp_path)
    board.log(board.run("key", "name", {}), [(7, {"error/e_rot": odd, "error/e_pos": 2.0})])
    held = contents(f"sqlite:///{tmp_path / 'mlflow.db'}")["key"]
    assert held["metrics"] == {"error/e_pos": [(7, 2.0)], "health/nonfinite": [(7, 1.0)]}
    assert held["tags"]["nonfinite/error/e_rot"] == f"{odd} at 7"


def test_only_a_decision_for_a_model_with_a_finite_number_makes_a_champion(tmp_path, run):
    best = run.iterations[0]
    folder, board = written(tmp_path, run), board_of(tmp_path)
    parent = board.run("key", "name", {})
    served = RunFolder(folder).weights(0, "mppi").parent
    board.model(parent, "key/model", "model", best.model, served, (6, 6), {})
    refused = GateDecision(promoted=False, measure="e_rot [deg]", number=3.0)
    for decision in (refused, refused.model_copy(update={"promoted": True, "number": math.nan})):
        board.promote(parent, best.model, decision)
        assert "flywheel.champion" not in held_tags(tmp_path)
    board.promote(parent, best.model, refused.model_copy(update={"promoted": True, "number": 2.5}))
    assert held_tags(tmp_path)["flywheel.champion.number"] == "2.5"


def held_tags(folder):
    from mlflow import MlflowClient  # slow to import

    client = MlflowClient(tracking_uri=f"sqlite:///{folder / 'mlflow.db'}")
    experiment = client.get_experiment_by_name("flywheel").experiment_id
    (run,) = client.search_runs([experiment])
    return run.data.tags


def test_a_champion_that_mlflow_does_not_know_is_left_out_and_the_rest_goes_on(tmp_path, caplog):
    board = Board(tmp_path, TrackingConfig(), "it's my robot")
    run = board.run("key", "name", {})
    odd = GateDecision(promoted=True, measure="e_rot [deg]", number=1.0, reference=float("nan"))
    board.promote(run, "unknown", odd)
    board.artifact(run, "nowhere.svg")
    board.log(run, [(0, {"closed_loop/success_rate": 0.5})])
    assert "no version" in caplog.text and "nowhere.svg is missing" in caplog.text
    held = contents(f"sqlite:///{tmp_path / 'mlflow.db'}")
    assert held["key"]["metrics"] == {"closed_loop/success_rate": [(0, 0.5)]}
