"""Servo motors: here ones that were made up, whose delay and gains are known."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.trunk_servos import BEFORE, DT, MOTORS, ServoLog, mjcf, write_servo_log
from flywheel.cli.console import console
from flywheel.cli.logs.reading import read_logs
from flywheel.robots import read_robot

GAINS, LATE = np.array([0.95, 0.98, 0.76, 0.97, 0.92, 0.94]), 20


@pytest.fixture(scope="module")
def log() -> ServoLog:
    """Motors that do what they were told 0.2 s before, by less."""
    time = np.arange(-LATE, 400)[:, None] * DT
    told = np.sin(time * np.linspace(1.0, 4.0, MOTORS)) * np.linspace(0.3, 0.9, MOTORS)
    return ServoLog(told[LATE:], np.concatenate([told[:1], told[: len(told) - LATE]]) * GAINS)


def test_delay_and_gains_are_found_again(log: ServoLog) -> None:
    delay, lag, gains = log.regression()
    assert (delay, lag) == (pytest.approx(LATE * DT), 0.0)
    np.testing.assert_allclose(gains, GAINS, rtol=1e-6)


def test_the_log_is_one_of_the_robot(log: ServoLog, tmp_path: Path) -> None:
    robot = read_robot(mjcf())
    write_servo_log(tmp_path / "monday.csv", log, robot)
    (read,) = read_logs([tmp_path / "monday.csv"], robot, DT, console())
    seen, begun = read.trajectory.observations, round(BEFORE / DT)
    assert np.isnan(seen.points[:begun]).all()
    height = robot.keyframe.qpos[2] - seen.points[begun:, 0, 2]
    np.testing.assert_allclose(height, 0.1 * log.had[begun:, 0], atol=1e-9)
    assert seen.winch[0, 2] == pytest.approx(1.0 + 0.1 * log.had[0, 2])
    assert np.isnan(seen.winch[1:]).all()
