"""Against the real MLflow: SQLite, a dead port, a server that hangs, a server that comes back."""

import contextlib
import logging
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request

import pytest

from flywheel.results import GateDecision
from flywheel.runtime.tracking.dashboard import ui_command
from flywheel.runtime.tracking.mlflow_client import MlflowReceiver, open_tracker
from flywheel.runtime.tracking.publish import publish_end, publish_iteration, publish_start
from flywheel.runtime.tracking.tracker import Tracker, TrackingConfig
from tests.full_disk import files_end_at
from tests.unit.reports.fake_run import fake_run

pytestmark = pytest.mark.slow

FAST = (0.05, 0.5)


def publish(tracker, run, folder, files=True):
    """All that a run logs, files and models included."""
    (folder / "models").mkdir(parents=True, exist_ok=True)
    (folder / "models" / "weights.txt").write_text("weights")
    (folder / "figure.svg").write_text("<svg/>")
    publish_start(tracker, run.config, {"config": run.config_digest}, run.name)
    for iteration in run.iterations:
        model = folder / "models" if iteration.arm == "mppi" and files else None
        publish_iteration(
            tracker,
            iteration,
            files=["figure.svg"] if files else [],
            model_folder=model,
            model_shape=(6, 6),
        )
    publish_end(tracker, run, files=["figure.svg"] if files else [])


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
    assert parent["files"] == ["figure.svg"]
    for iteration in run.iterations:
        child = held[f"{key}/{iteration.arm}-{iteration.iteration:04d}"]
        assert child["parent"]
        assert child["status"] == "FINISHED"
        assert child["snapshots"] == [iteration.snapshot[:36]]
        assert child["snapshot"] == iteration.snapshot
        assert len(child["metrics"]["training/loss"]) == len(iteration.curve)
        assert child["models"] == (iteration.arm == "mppi")
    mine = [i for i in run.iterations if i.arm == "mppi"]
    assert held["registry"] == sorted(i.model for i in mine)
    best = [i for i in mine if i.gate.promoted][-1]
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
    class Twice(MlflowReceiver):
        """Delivers every record, loses MLflow's first answer, and so delivers it again."""

        answered = False

        def deliver(self, record):
            super().deliver(record)
            self.answered = not self.answered
            if self.answered:
                raise ConnectionError("the answer was lost")

    receiver = Twice(tmp_path, TrackingConfig(), "prism3")
    tracker = Tracker(tmp_path, run.key, receiver, retry_seconds=(0.001, 0.001))
    publish(tracker, run, tmp_path)
    assert tracker.close(120), tracker.problem
    assert not (tmp_path / "outbox.rejected.jsonl").exists()
    held = contents(f"sqlite:///{tmp_path / 'mlflow.db'}")
    check(held, run)

    again = open_tracker(tmp_path, run.key, "prism3", retry_seconds=FAST)  # a resume logs all again
    publish(again, run, tmp_path)
    assert again.close(120), again.problem
    assert contents(f"sqlite:///{tmp_path / 'mlflow.db'}") == held


def test_a_killed_run_is_reopened_and_ends_as_finished(tmp_path, run):
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    states = []
    for status in ("KILLED", "FINISHED"):
        tracker = open_tracker(tmp_path, run.key, "prism3", retry_seconds=FAST)
        publish_start(tracker, run.config, {})
        tracker.end(run.key, status)
        assert tracker.close(120), tracker.problem
        states.append(
            {key: held["status"] for key, held in contents(uri).items() if key == run.key}
        )
    assert states == [{run.key: "KILLED"}, {run.key: "FINISHED"}]


def test_a_dead_server_delays_no_call_and_gets_everything_once_when_it_comes_up(tmp_path, run):
    port = free_port()
    folder = tmp_path / "run"
    config = TrackingConfig(uri=f"http://127.0.0.1:{port}", request_seconds=2)
    tracker = open_tracker(folder, run.key, "prism3", config, FAST)
    start = time.monotonic()
    publish(tracker, run, folder)
    assert time.monotonic() - start < 5
    assert "refused" in first_problem(tracker)
    waiting = tracker.pending()
    assert waiting > 20
    assert not tracker.close(0.1)
    with mlflow_server(tmp_path / "server", port):
        later = open_tracker(folder, run.key, "prism3", config, FAST)
        publish(later, run, folder)  # what a resumed loop logs again changes nothing
        assert later.close(120), later.problem
        check(contents(config.uri), run)
    assert not (folder / "outbox.rejected.jsonl").exists()


def test_a_server_that_accepts_and_never_answers_blocks_nobody(tmp_path, run):
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen(16)
        config = TrackingConfig(
            uri=f"http://127.0.0.1:{listener.getsockname()[1]}", request_seconds=1
        )
        tracker = open_tracker(tmp_path, run.key, "prism3", config, FAST)
        start = time.monotonic()
        publish(tracker, run, tmp_path)
        assert time.monotonic() - start < 5
        assert "timed out" in first_problem(tracker)
        start = time.monotonic()
        assert not tracker.close(0.5)
        assert time.monotonic() - start < 3
        assert tracker.pending() > 20


def test_the_database_is_whole_even_if_another_process_makes_it_at_the_same_time(tmp_path):
    script = (
        "import sys; from pathlib import Path; from flywheel.runtime.tracking import mlflow_client;"
        "mlflow_client._configure(5); mlflow_client._database(Path(sys.argv[1]) / 'mlflow.db')"
    )
    with subprocess.Popen([sys.executable, "-c", script, str(tmp_path)]) as other:
        tracker = open_tracker(tmp_path, "key", "prism3", retry_seconds=FAST)
        tracker.open("key", "name", {})
        assert tracker.close(120), tracker.problem
        assert other.wait(180) == 0
    assert contents(f"sqlite:///{tmp_path / 'mlflow.db'}")["key"]["status"] == "RUNNING"
    assert sorted(path.name for path in tmp_path.glob("*mlflow*")) == ["mlflow.db"]


def test_a_database_that_was_lost_is_made_anew_and_told_everything(tmp_path):
    tracker = open_tracker(tmp_path / "run", "key", "prism3", retry_seconds=FAST)
    tracker.open("key", "name", {})
    tracker.log("key", {"closed_loop/success_rate": 0.5}, step=2)
    assert tracker.close(120), tracker.problem
    for name in ("removed", "emptied"):  # a copy: MLflow keeps the files it knows open
        folder = tmp_path / name
        shutil.copytree(tmp_path / "run", folder)
        (folder / "mlflow.db").unlink()
        if name == "emptied":
            (folder / "mlflow.db").touch()
        again = open_tracker(folder, "key", "prism3", retry_seconds=FAST)
        assert again.close(120), again.problem
        held = contents(f"sqlite:///{folder / 'mlflow.db'}")
        assert held["key"]["metrics"] == {"closed_loop/success_rate": [(2, 0.5)]}
        assert not (folder / "outbox.rejected.jsonl").exists()


def test_a_damaged_database_delays_nobody_and_is_told_in_one_line(tmp_path, caplog, capfd):
    for damaged in (b"no database", bytes(8192)):
        (tmp_path / "mlflow.db").write_bytes(damaged)
        tracker = open_tracker(tmp_path, "key", "prism3", retry_seconds=FAST)
        tracker.open("key", "name", {})
        assert "is damaged" in first_problem(tracker)
        start = time.monotonic()
        assert not tracker.close()
        assert time.monotonic() - start < 10
        assert tracker.pending() > 0
    assert [record.levelname for record in caplog.records] == ["WARNING", "WARNING"]
    assert "--resume makes a new one" in caplog.text
    assert capfd.readouterr().err == ""
    (tmp_path / "mlflow.db").unlink()  # moved away: nothing was lost
    later = open_tracker(tmp_path, "key", "prism3", retry_seconds=FAST)
    assert later.close(120), later.problem
    assert contents(f"sqlite:///{tmp_path / 'mlflow.db'}")["key"]["status"] == "RUNNING"


def test_a_disk_that_fills_up_while_the_database_is_used_is_told_in_one_line(
    tmp_path, caplog, capfd
):
    # As it is unless another test imported MLflow before a tracker could tell it to be quiet.
    caplog.set_level(logging.CRITICAL, logger="mlflow")
    caplog.handler.setLevel(logging.NOTSET)
    tracker = open_tracker(tmp_path, "key", "prism3", retry_seconds=FAST)
    tracker.open("key", "name", {})
    assert tracker.flush(120), tracker.problem
    with files_end_at((tmp_path / "mlflow.db").stat().st_size):
        tracker.log_rows("key", [(step, {"training/loss": 0.5}) for step in range(3000)])
        assert first_problem(tracker)
        assert not tracker.close(0.5)
    ours = [record for record in caplog.records if record.name.startswith("flywheel")]
    assert len(ours) == 1, caplog.text
    assert capfd.readouterr().err == ""
    later = open_tracker(tmp_path, "key", "prism3", retry_seconds=FAST)
    assert later.close(120), later.problem
    held = contents(f"sqlite:///{tmp_path / 'mlflow.db'}")["key"]
    assert len(held["metrics"]["training/loss"]) == 3000


def test_a_champion_that_mlflow_does_not_know_is_set_aside_and_the_rest_goes_on(tmp_path):
    tracker = open_tracker(tmp_path, "key", "it's my robot", retry_seconds=FAST)
    tracker.open("key", "name", {})
    odd = GateDecision(promoted=True, measure="e_rot [deg]", number=1.0, reference=float("nan"))
    tracker.promote("unknown", odd)
    tracker.log("key", {"closed_loop/success_rate": 0.5})
    assert tracker.close(120), tracker.problem
    assert "no version" in (tmp_path / "outbox.rejected.jsonl").read_text()
    held = contents(f"sqlite:///{tmp_path / 'mlflow.db'}")
    assert held["key"]["metrics"] == {"closed_loop/success_rate": [(0, 0.5)]}
