from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from flywheel.evaluation import rotation_error, squared_point_error, squared_position_error
from flywheel.evaluation.statistics import shows_turn
from tests import draws


def test_a_shift_gives_its_squared_length_and_no_rotation(robot, resting):
    moved = resting + np.array([0.3, -0.4, 1.2])
    np.testing.assert_allclose(squared_position_error(robot, resting, moved), [1.69, 1.69])
    np.testing.assert_allclose(squared_point_error(robot, resting, moved), [1.69] * 5)
    np.testing.assert_allclose(rotation_error(robot, resting, moved), [0.0, 0.0], atol=1e-12)


def test_a_turned_body_is_off_by_the_angle_it_was_turned_by(robot, resting):
    seed = draws.seed()
    rng = np.random.default_rng(seed)
    angles = np.concatenate([rng.uniform(0.0, 180.0, 5), [1e-7, 180.0]])
    for angle in angles:
        axis = rng.standard_normal(3)
        axis /= np.linalg.norm(axis)
        base = Rotation.random(rng=seed)
        turn = Rotation.from_rotvec(np.radians(angle) * axis)
        truth, turned = base.apply(resting), turn.apply(base.apply(resting))
        platform = rotation_error(robot, truth, turned)[1]
        np.testing.assert_allclose(platform, angle, atol=1e-5, rtol=1e-6, err_msg=f"seed {seed}")
        rod = base.apply([0.0, 0.0, 1.0])
        expected = np.degrees(
            np.arctan2(np.linalg.norm(np.cross(rod, turn.apply(rod))), rod @ turn.apply(rod))
        )
        np.testing.assert_allclose(
            rotation_error(robot, truth, turned)[0], expected, atol=1e-9, err_msg=f"seed {seed}"
        )


def test_roll_of_a_rod_about_its_own_axis_is_no_error(robot, resting):
    turned = Rotation.from_euler("z", 77, degrees=True).apply(resting)
    rod, platform = rotation_error(robot, resting, turned)
    assert rod == 0.0
    np.testing.assert_allclose(platform, 77.0)


def test_the_center_of_mass_is_a_combination_of_the_points(robot, resting):
    rod, platform = robot.bodies
    np.testing.assert_allclose(robot.com_weights(rod), [0.5, 0.5])
    weights = robot.com_weights(platform)
    np.testing.assert_allclose(weights.sum(), 1.0)
    np.testing.assert_allclose(weights @ resting[2:], platform.com, atol=1e-12)


def test_a_missing_point_makes_its_body_missing_and_no_other(robot, resting):
    truth = np.stack([resting, resting])
    truth[1, 3, 0] = np.nan
    for statistic in (squared_position_error, rotation_error, squared_point_error):
        missing = np.isnan(statistic(robot, truth, np.stack([resting, resting])))
        wanted = [3] if statistic is squared_point_error else [1]
        assert np.flatnonzero(missing[1]).tolist() == wanted, statistic
        assert not missing[0].any(), statistic


def test_one_point_shows_no_turn(robot):
    rod, platform = robot.bodies
    assert shows_turn(robot, rod) and shows_turn(robot, platform)
    assert not shows_turn(robot, replace(rod, points=rod.points[:1]))
    here = tuple(replace(point, offset=robot.points[0].offset) for point in robot.points)
    assert not shows_turn(replace(robot, points=here), platform)
