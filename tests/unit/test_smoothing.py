"""Three ways to find position and velocity; `local_regression` is tested with the windows it serves."""

import numpy as np
import pytest

from flywheel.errors import DataError
from flywheel.smoothing import causal_polynomial, savitzky_golay
from tests import draws


def test_motions_are_fitted_exactly_by_their_own_polynomial() -> None:
    t = np.arange(-4, 1) * 0.01
    place = 1.0 + 2.0 * t[:, None] - 30.0 * (t**2)[:, None]
    points = np.stack([place * 1.0, place * 2.0, np.full_like(place, np.nan)], axis=1)[None]
    points = np.repeat(points, 3, axis=-1)
    points[0, 1, 0] = np.nan
    now, speed = causal_polynomial(points, 0.01, 2)
    np.testing.assert_allclose(now[0, :2], [[1.0] * 3, [2.0] * 3], atol=1e-9)
    np.testing.assert_allclose(speed[0, :2], [[2.0] * 3, [4.0] * 3], atol=1e-7)
    assert np.isnan(now[0, 2]).all()
    assert (speed[0, 2] == 0).all()


def test_smoothing_keeps_motion_takes_out_noise_and_bridges_gaps() -> None:
    seed = draws.seed()
    rng, time = np.random.default_rng(seed), 0.01 * np.arange(200)
    truth = np.sin(2 * time[:, None, None] + rng.uniform(0, 6, (4, 3)))
    noisy = truth + rng.normal(0, 0.01, truth.shape)
    noisy[50:55, 1] = np.nan
    places, speeds = savitzky_golay(noisy, 0.01, 0.17)
    assert np.sqrt(((places - truth) ** 2).mean()) < 0.006, seed
    assert np.sqrt(((speeds - np.gradient(truth, 0.01, axis=0)) ** 2).mean()) < 0.15, seed


def test_a_point_that_was_never_seen_is_refused() -> None:
    blind = np.zeros((20, 2, 3))
    blind[:, 1] = np.nan
    with pytest.raises(DataError, match="Tracked point 1 was never seen"):
        savitzky_golay(blind, 0.01, 0.17)
