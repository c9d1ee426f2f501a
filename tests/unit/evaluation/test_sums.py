import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flywheel.evaluation import ExactSum
from flywheel.evaluation.sums import LARGEST
from tests import draws

VALUES = st.lists(
    st.one_of(st.floats(0.0, 1e5), st.floats(0.0, 1e-6), st.just(float("nan"))), max_size=40
)


@settings(deadline=None)
@given(VALUES, st.data())
def test_any_partition_in_any_order_adds_up_to_the_same_bits(values, data):
    array = np.array(values).reshape(-1, 1, 1)
    order = data.draw(st.permutations(range(len(values))))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(values)), max_size=4)))
    total = ExactSum.zeros((1, 1))
    for part in np.split(array[order], cuts):
        total = total + ExactSum.of(part)
    assert total == ExactSum.of(array)


@settings(deadline=None)
@given(VALUES)
def test_the_mean_is_the_mean_of_what_is_present(values):
    present = [v for v in values if not np.isnan(v)]
    got = ExactSum.of(np.array(values).reshape(-1, 1)).mean[0]
    if present:
        np.testing.assert_allclose(got, np.mean(present), rtol=1e-12, atol=2.0**-59)
    else:
        assert np.isnan(got)


def test_adding_the_empty_sum_changes_no_bit():
    values = np.random.default_rng(draws.seed()).uniform(0, 10, (7, 5, 3))
    one = ExactSum.of(values)
    assert one + ExactSum.zeros((0, 3)) == one == ExactSum.zeros((0, 3)) + one


def test_rows_beyond_the_shorter_sum_are_kept():
    total = ExactSum.of(np.ones((2, 3, 1))) + ExactSum.of(np.ones((4, 5, 1)))
    assert total.count[:, 0].tolist() == [6, 6, 6, 4, 4]


@pytest.mark.parametrize("value", [1.5e6, 3.3e12, 6.25e16, 1e40, 1e77])
def test_a_huge_value_counts_in_full(value):
    total = ExactSum.of(np.array([[value], [1.0], [value]])) + ExactSum.of(np.full((1, 1), value))
    assert total.mean[0] == (3 * value + 1.0) / 4


def test_a_value_that_no_prediction_makes_is_cut_off_instead_of_overflowing():
    total = ExactSum.of(np.array([[1e300], [np.inf]] * 500))
    assert total.total[0] == 1000 * LARGEST


def test_sums_over_axes_agree_with_numpy():
    values = np.random.default_rng(draws.seed()).uniform(0, 3, (6, 4, 2))
    np.testing.assert_allclose(ExactSum.of(values).over((0, 1)).total, values.sum(), rtol=1e-12)
