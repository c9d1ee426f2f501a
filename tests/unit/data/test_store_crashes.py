"""Writers that die, or write side by side."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flywheel.data import TrajectoryStore

KILLS = int(os.environ.get("FLYWHEEL_KILLS", "8"))

EPISODES = """
import sys
import numpy as np
from flywheel.data import TrajectoryStore
from flywheel.records import Episode, Observation, Provenance, Trajectory

def commit_all(url, prefix, count, acknowledge):
    store = TrajectoryStore(url)
    for i in range(count):
        rng = np.random.default_rng(i)
        points, winch = rng.standard_normal((401, 6, 3)), rng.standard_normal((401, 6))
        track = Trajectory(Observation(points, winch), rng.standard_normal((400, 6)), 0.01)
        name = f"{prefix}-{i:04d}"
        store.commit(name, [Episode(name, track, Provenance(robot="r"), "train")])
        acknowledge(name)
"""

WRITER = (
    EPISODES
    + """
commit_all(sys.argv[1], sys.argv[2], int(sys.argv[3]), lambda name: print(name, flush=True))
"""
)

# One process imports everything once and forks the writers that it kills.
KILLER = (
    EPISODES
    + """
import os, random, signal, time

for kill in range(int(sys.argv[2])):
    out, into = os.pipe()
    writer = os.fork()
    if writer == 0:
        commit_all(sys.argv[1], f"k{kill:03d}", 1000, lambda n: os.write(into, f"{n}\\n".encode()))
    os.close(into)
    with open(out) as answers:
        for _ in range(random.randrange(3)):  # however busy the machine is, some are stored
            print(answers.readline().strip())
        time.sleep(random.uniform(0.0, 0.15))
        os.kill(writer, signal.SIGKILL)
        os.waitpid(writer, 0)
        print(answers.read().strip())
"""
)


def start(program: str, *arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def acknowledged(process: subprocess.Popen[str]) -> list[str]:
    """Names of the episodes of which a writer was told that they are stored."""
    names = process.communicate()[0].split()
    assert process.returncode == 0
    return names


def check_whole(root: Path, names: list[str]) -> None:
    """Everything acknowledged is there, and everything that is there is whole and right."""
    store = TrajectoryStore(root)
    assert set(names) <= set(store.committed())
    assert store.verify() == ()
    for name in store.committed():
        points = store.read(name).trajectory.observations.points
        expected = np.random.default_rng(int(name[-4:])).standard_normal((401, 6, 3))
        np.testing.assert_array_equal(points, expected)


@pytest.mark.slow
@pytest.mark.chaos
@pytest.mark.nightly
def test_writers_killed_at_random_instants_lose_nothing_and_leave_no_half_episode(tmp_path):
    names = acknowledged(start(KILLER, tmp_path, KILLS))
    assert len(names) >= KILLS / 4
    check_whole(tmp_path, names)
    TrajectoryStore(tmp_path).sweep()
    assert list((tmp_path / "tmp").iterdir()) == []


@pytest.mark.slow
@pytest.mark.chaos
def test_three_writers_at_once_lose_nothing(tmp_path):
    together = [start(WRITER, tmp_path, f"w{i:02d}", 8) for i in range(3)]
    names = [name for process in together for name in acknowledged(process)]
    assert len(names) == 24
    check_whole(tmp_path, names)


@pytest.mark.slow
@pytest.mark.chaos
@pytest.mark.nightly
def test_three_writers_of_the_same_segments_agree(tmp_path):
    together = [start(WRITER, tmp_path, "all", 4) for _ in range(3)]
    for process in together:
        assert len(acknowledged(process)) == 4
    assert len(TrajectoryStore(tmp_path).committed()) == 4
    assert TrajectoryStore(tmp_path).verify() == ()
    assert list((tmp_path / "tmp").iterdir()) == []
