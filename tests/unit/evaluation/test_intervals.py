import numpy as np
import pytest

from flywheel.errors import DataError
from flywheel.evaluation import rmse_ratio_interval, success_interval
from tests import draws


def test_wilsons_interval_equals_its_closed_form():
    n, k, z = 24, 18, 1.959963984540054
    p = k / n
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    got = success_interval(k, n)
    np.testing.assert_allclose((got.value, got.low, got.high), (p, middle - half, middle + half))


def test_the_exact_interval_of_no_failure_is_the_rule_of_its_tail():
    got = success_interval(10, 10, method="exact")
    assert got.high == 1.0
    assert got.low == pytest.approx(0.025 ** (1 / 10))


def test_without_a_trial_nothing_is_known():
    got = success_interval(0, 0)
    assert np.isnan(got.value) and (got.low, got.high) == (0.0, 1.0)


def test_impossible_counts_are_refused():
    with pytest.raises(DataError, match="between 0 and 3"):
        success_interval(4, 3)


def test_the_interval_of_a_ratio_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(draws.seed())
    covered = 0
    for trial in range(300):
        hard = rng.gamma(4.0, 1.0, 40)  # common to both models
        new, old = hard * rng.gamma(20.0, 0.8, 40), hard * rng.gamma(20.0, 1.0, 40)
        interval = rmse_ratio_interval(new, old, seed=trial, resamples=400)
        covered += interval.low <= np.sqrt(0.8) <= interval.high
    assert 0.86 < covered / 300 < 0.99


def test_an_interval_of_one_episode_is_refused():
    with pytest.raises(DataError, match="at least 2 episodes"):
        rmse_ratio_interval(np.ones(1), np.ones(1), seed=0)
