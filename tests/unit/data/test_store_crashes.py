"""Writers that die, or write side by side."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from flywheel.data import TrajectoryStore

KILLS = int(os.environ.get("FLYWHEEL_KILLS", "8"))

WRITER = """
import sys
import numpy as np
from flywheel.data import TrajectoryStore
from flywheel.records import Episode, Observation, Provenance, Trajectory

url, prefix, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
store = TrajectoryStore(url)
print("ready", flush=True)
for i in range(count):
    rng = np.random.default_rng(i)
    points, winch = rng.standard_normal((401, 6, 3)), rng.standard_normal((401, 6))
    track = Trajectory(Observation(points, winch), rng.standard_normal((400, 6)), 0.01)
    name = f"{prefix}-{i:04d}"
    store.commit(name, [Episode(name, track, Provenance(robot="r"), "train")])
    print(name, flush=True)
"""


def writer(url: Path, prefix: str, count: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", WRITER, str(url), prefix, str(count)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def acknowledgement(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def acknowledged(process: subprocess.Popen[str]) -> list[str]:
    assert process.stdout is not None
    names = process.stdout.read().splitlines()
    process.stdout.close()
    process.wait()
    return [name for name in names if len(name) == len("k00-0000")]


def check_whole(root: Path, names: list[str]) -> None:
    """Everything acknowledged is there, and everything that is there is whole and right."""
    store = TrajectoryStore(root)
    assert set(names) <= set(store.committed())
    assert store.verify() == ()
    for name in store.committed():
        points = store.read(name).trajectory.observations.points
        expected = np.random.default_rng(int(name[-4:])).standard_normal((401, 6, 3))
        np.testing.assert_array_equal(points, expected)


@pytest.mark.chaos
def test_writers_killed_at_random_instants_lose_nothing_and_leave_no_half_episode(tmp_path):
    rng = np.random.default_rng()
    names: list[str] = []
    for kill in range(KILLS):
        process = writer(tmp_path, f"k{kill:02d}", 1000)
        for _ in range(int(rng.integers(0, 3))):  # however busy the machine is, some are stored
            names.append(acknowledgement(process))
        time.sleep(rng.uniform(0.0, 0.2))
        process.kill()
        names += acknowledged(process)
    check_whole(tmp_path, names)
    TrajectoryStore(tmp_path).sweep()
    assert list((tmp_path / "tmp").iterdir()) == []


@pytest.mark.chaos
def test_three_writers_at_once_lose_nothing(tmp_path):
    together = [writer(tmp_path, f"w{i:02d}", 8) for i in range(3)]
    names = [name for process in together for name in acknowledged(process)]
    assert len(names) == 24
    check_whole(tmp_path, names)


@pytest.mark.chaos
def test_three_writers_of_the_same_segments_agree(tmp_path):
    together = [writer(tmp_path, "all", 4) for _ in range(3)]
    for process in together:
        acknowledged(process)
        assert process.returncode == 0
    assert len(TrajectoryStore(tmp_path).committed()) == 4
    assert TrajectoryStore(tmp_path).verify() == ()
    assert list((tmp_path / "tmp").iterdir()) == []
