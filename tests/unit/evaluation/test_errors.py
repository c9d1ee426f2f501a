import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flywheel.errors import DataError
from flywheel.evaluation import ErrorTable


def test_e_pos_and_e_rot_equal_values_computed_by_hand(robot, resting):
    """Rod off by (0.3, 0, 0.4), platform by nothing; L = 2 m, 2 lead times, 1 window."""
    truth = np.stack([resting, resting])[None]
    predicted = truth.copy()
    predicted[0, 1, :2] += [0.3, 0.0, 0.4]  # at the second lead time only
    table = ErrorTable.between(robot, 0.01, truth, predicted)
    # squared errors 0, 0, 0.25, 0 -> mean 0.0625 m^2
    assert table.e_pos_mse == pytest.approx(100 * 0.0625 / 2)
    assert table.e_pos_rmse == pytest.approx(100 * 0.25 / 2)
    assert table.e_rot == 0.0
    assert table.by_lead_time()["e_pos_mse"][-1] == pytest.approx(100 * 0.125 / 2)
    lead = table.by_lead_time()
    np.testing.assert_allclose(lead["seconds"], [0.01, 0.02])
    np.testing.assert_allclose(lead["e_pos_rmse"], [0.0, 100 * np.sqrt(0.125) / 2])


def test_e_rot_is_the_mean_angle_in_degrees(robot, resting):
    turned = Rotation.from_euler("x", 30, degrees=True).apply(resting)
    truth, predicted = np.stack([[resting] * 3]), np.stack([[resting, turned, turned]])
    table = ErrorTable.between(robot, 0.01, truth, predicted)
    assert table.e_rot == pytest.approx(20.0)
    assert table.by_lead_time()["e_rot"][-1] == pytest.approx(30.0)


def test_what_is_missing_gets_no_weight(robot, resting):
    truth = np.stack([np.stack([resting] * 4)] * 2)
    predicted = truth + 0.1
    truth[1, 2:] = np.nan
    table = ErrorTable.between(robot, 0.01, truth, predicted)
    assert table.e_pos_mse == pytest.approx(100 * 0.03 / 2)
    assert table.position.count[:, 0].tolist() == [2, 2, 1, 1]


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(st.integers(1, 12), st.integers(0, 2**31), st.data())
def test_tables_add_exactly_over_any_partition(robot, resting, windows, seed, data):
    rng = np.random.default_rng(seed)
    truth = resting + rng.standard_normal((windows, 6, 5, 3))
    truth[rng.random(truth.shape[:3]) < 0.1] = np.nan
    predicted = resting + rng.standard_normal((windows, 6, 5, 3))
    cuts = sorted(data.draw(st.lists(st.integers(0, windows), max_size=4)))
    whole = ErrorTable.between(robot, 0.01, truth, predicted)
    total = ErrorTable.empty(robot, 0.01)
    for one, other in zip(np.split(truth, cuts), np.split(predicted, cuts), strict=True):
        total = total + ErrorTable.between(robot, 0.01, one, other)
    assert total == whole
    numbers = [
        (t.e_pos_mse, t.e_pos_rmse, t.e_rot, t.point.over((0, 1)).mean) for t in (total, whole)
    ]
    assert numbers[0] == numbers[1]


def test_an_empty_table_says_nan_and_not_zero(robot):
    assert np.isnan(ErrorTable.empty(robot, 0.01).e_pos_mse)
    assert np.isnan(ErrorTable.empty(robot, 0.01).e_rot)


def test_tables_of_different_time_steps_do_not_add(robot):
    with pytest.raises(DataError, match="do not add"):
        _ = ErrorTable.empty(robot, 0.01) + ErrorTable.empty(robot, 0.02)


def test_shapes_that_differ_are_refused(robot):
    with pytest.raises(DataError, match="shape"):
        ErrorTable.between(robot, 0.01, np.zeros((1, 3, 5, 3)), np.zeros((1, 4, 5, 3)))
