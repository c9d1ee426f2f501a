"""A node of a two-node cluster is lost in the middle, episodes are on S3: the outcome is the same."""

import csv
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from ray.cluster_utils import Cluster as Nodes

from flywheel.data import TrajectoryStore
from flywheel.results import RunResult
from tests.chaos.killing import ROOT, busy_workers, outcome

pytestmark = [pytest.mark.nightly, pytest.mark.ray, pytest.mark.slow]
FAST = {"health_check_period_ms": 500, "health_check_failure_threshold": 3}
LONG = 300
PIPELINE = (sys.executable, "pipelines/paper_table.py", "sim2sim", "--size", "smoke")
TABLE = (*PIPELINE, "--only", "prism3.nominal.")


@pytest.fixture
def nodes(bucket: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Nodes]:
    """The first node; its processes know the bucket's service."""
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    head = {"num_cpus": 1, "_system_config": FAST, "include_dashboard": False}
    nodes = Nodes(initialize_head=True, head_node_args=head)
    yield nodes
    nodes.shutdown()


def lose_a_node(nodes: Nodes, command: tuple[object, ...], busy: str, log: Path) -> None:
    """Run a command on two nodes; the second is killed as soon as a worker of a kind is busy there."""
    other = nodes.add_node(num_cpus=1)
    raylet = other.all_processes["raylet"][0].process
    with log.open("wb") as words:
        driver = subprocess.Popen(
            [*map(str, command), "--address", nodes.address],
            cwd=ROOT,
            stdout=words,
            stderr=words,
        )
    try:
        while busy not in busy_workers(raylet.pid).values():
            assert driver.poll() is None, log.read_text()
            time.sleep(0.05)
        nodes.remove_node(other, allow_graceful=False)
        assert driver.poll() is None, "it ended before"
        assert driver.wait(LONG) == 0, log.read_text()[-3000:]
    finally:
        driver.kill()
        driver.wait()


def numbers(folder: Path) -> list[dict[str, str]]:
    """The rows of a table without the processor's times."""
    with (folder / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [{name: text for name, text in row.items() if "_cpu" not in name} for row in rows]


@pytest.mark.usefixtures("plain_run")
def test_a_run_that_loses_a_node_comes_to_the_same_digests(nodes, bucket, stranger, tmp_path):
    folder = tmp_path / "run"
    flywheel = Path(sys.executable).with_name("flywheel")
    command = (flywheel, "run", "configs/smoke.yaml", f"store={bucket}", "--folder", folder)
    lose_a_node(nodes, command, "trainer", tmp_path / "log")
    assert sum(each.restarts for each in RunResult.load(folder).iterations) > 0
    assert outcome(folder) == outcome(stranger.folder / "runs" / "smoke")
    assert TrajectoryStore(bucket).verify() == ()


def test_a_table_that_loses_a_node_has_the_same_digests_and_numbers(nodes, bucket, tmp_path):
    alone, folder = tmp_path / "alone", tmp_path / "table"
    subprocess.run([*TABLE, "--folder", alone], cwd=ROOT, check=True)
    command = (*TABLE, "--folder", folder, f"run.store={bucket}")
    lose_a_node(nodes, command, "cell of a table", tmp_path / "log")
    rows = numbers(folder)
    assert rows == numbers(alone) and len(rows) == 11
    assert all(row["train"] and row["test"] for row in rows)
    assert TrajectoryStore(f"{bucket}/prism3").verify() == ()
