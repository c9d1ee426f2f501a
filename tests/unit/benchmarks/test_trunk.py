"""A trunk: here one that was made up, whose motions are linear in its motors' angles."""

import numpy as np
import pytest

from benchmarks.trunk import LEARNED, MOVED, TESTED, Trunk, TrunkLog
from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig
from flywheel.dynamics.plant import Plant
from flywheel.robots import read_robot

REST = np.array([[0.10, -0.11, -0.11], [0.10, -0.11, -0.20], [0.10, -0.10, -0.32]])
GAINS = np.random.default_rng(3).normal(0.0, 0.03, (6, 3, 3))  # [m/rad]


@pytest.fixture(scope="module")
def log() -> TrunkLog:
    told = np.random.default_rng(0).uniform(-0.5, 0.5, (LEARNED.stop, 6))
    had = np.concatenate([told[:1], told])
    return TrunkLog(told, had, REST + np.einsum("tm,mdx->tdx", had, GAINS), REST)


def test_how_far_a_motor_moves_its_disc_is_found_again(log: TrunkLog) -> None:
    np.testing.assert_allclose(log.pulls(), GAINS[range(6), MOVED, :2], atol=1e-9)


def test_each_motor_pulls_its_disc_towards_its_cable(log: TrunkLog) -> None:
    trunk = Trunk(log.rest, log.pulls())
    robot = read_robot(trunk.mjcf())
    ChunkNetwork(robot, NetworkConfig.lean())
    plant = Plant(robot)
    angles = np.concatenate([np.zeros((1, 6)), 0.2 * np.eye(6)])
    told = np.repeat(trunk.positions(angles)[:, None], 300, axis=1)
    ended = plant.simulate(plant.settle(2.0, 7), told).observations.points[:, -1]
    for motor, disc in enumerate(MOVED):
        moved = (ended[1 + motor] - ended[0])[disc, :2]
        pull = trunk.pulls[motor]
        assert moved @ pull > 0.8 * np.linalg.norm(moved) * np.linalg.norm(pull)


def test_an_episode_is_a_part_of_the_log(log: TrunkLog) -> None:
    trunk = Trunk(log.rest, log.pulls())
    robot = read_robot(trunk.mjcf())
    first, *_, last = trunk.episodes(log, robot, range(50, 2600), 1000)
    assert (first.trajectory.steps, last.trajectory.steps) == (1000, 549)
    np.testing.assert_array_equal(first.trajectory.observations.points, log.discs[50:1051])
    np.testing.assert_array_equal(last.trajectory.controls, trunk.positions(log.told[2050:2599]))


def test_tested_rows_are_not_for_learning(log: TrunkLog) -> None:
    trunk = Trunk(log.rest, log.pulls())
    robot = read_robot(trunk.mjcf())
    learned = trunk.episodes(log, robot, LEARNED, 1000)
    assert [n for n, each in enumerate(learned) if each.split == "validation"] == [3, 8]
    assert {each.split for each in learned} == {"train", "validation"}
    long = TrunkLog(
        *(np.tile(x, (2, *[1] * (x.ndim - 1))) for x in (log.told, log.had, log.discs)), REST
    )
    assert {each.split for each in trunk.episodes(long, robot, TESTED, 700)} == {"test"}
