"""A real robot's log: here one that was made up, whose gains and clock are known."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.logs import write_log
from benchmarks.planar_platform import DT, FRAME, Platform, Take, clock_offset, mjcf
from flywheel.cli.console import console
from flywheel.cli.logs.reading import read_logs
from flywheel.robots import load_robot

CORNERS = np.array([[1.4, -0.1, 0.0], [1.5, -0.1, 2.4], [-1.4, -0.1, 2.5], [-1.5, -0.1, 0.1]])
PLATE = np.array([[0.07, 0.0, -0.06], [0.07, 0.0, 0.06], [-0.07, 0.0, 0.06], [-0.07, 0.0, -0.06]])
GAINS, LATE = np.array([0.94, 0.93, 0.95, 0.9]), 1.234


@pytest.fixture(scope="module")
def take() -> Take:
    """A plate that goes in circles, and a controller with other clocks and drums."""
    time = np.arange(0.0, 12.0, 1 / 120)
    platform = Platform.of(Take(time[:2], _markers(time[:2]), CORNERS, np.zeros((0, 4))))
    log_time = np.arange(0.0, 9.0, DT)
    told = [(platform.lengths(each, CORNERS) - 0.1) / GAINS for each in _markers(log_time + LATE)]
    markers = _markers(time)
    markers[100:110] = np.nan
    return Take(time, markers, CORNERS, np.array(told))


def _markers(time: np.ndarray) -> np.ndarray:
    """(T, 4, 3)."""
    middle = np.stack([np.sin(time**1.3), 0 * time - 0.16, 1.2 + 0.5 * np.cos(time**1.5)], axis=1)
    turns = Rotation.from_rotvec(np.outer(0.1 * np.sin(time), [0.0, 1.0, 0.0]))
    return np.stack([turn.apply(PLATE) for turn in turns]) + middle[:, None]


def test_clocks_and_gains_are_found_again(take: Take) -> None:
    platform = Platform.of(take)
    lengths = np.full((len(take.time), 4), np.nan)
    seen = np.isfinite(take.markers).all(axis=(1, 2))
    lengths[seen] = [platform.lengths(each, take.corners) for each in take.markers[seen]]
    offset, gains = clock_offset(take, lengths)
    assert offset == pytest.approx(LATE, abs=2e-3)
    np.testing.assert_allclose(gains, GAINS, atol=2e-3)


def test_its_robot_and_its_logs_can_be_read(take: Take, tmp_path: Path) -> None:
    platform = Platform.of(take)
    file = tmp_path / "planar4.xml"
    file.write_text(mjcf(platform, take.corners, take.markers[0].mean(axis=0)))
    robot = load_robot(str(file))
    assert [winch.name for winch in robot.winches] == [f"winch_{n}" for n in FRAME]
    rows, commands = _markers(np.arange(51) * DT), np.full((50, 4), 0.1)
    begin = platform.lengths(rows[0], take.corners)
    write_log(tmp_path / "monday.csv", rows, commands, begin, DT, robot)
    (log,) = read_logs([tmp_path / "monday.csv"], robot, DT, console())
    seen = log.trajectory.observations
    np.testing.assert_allclose(seen.points, rows, atol=1e-5)
    np.testing.assert_allclose(seen.winch[0], begin, atol=1e-4)
    assert np.isnan(seen.winch[1:]).all()
