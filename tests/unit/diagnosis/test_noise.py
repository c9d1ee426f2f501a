"""The noise is found from measurements alone."""

from __future__ import annotations

import numpy as np
import pytest

from flywheel.diagnosis.fitting.noise import noise_floor
from flywheel.errors import DataError
from tests import draws


def moving(rng: np.random.Generator, samples: int = 400) -> np.ndarray:
    """(samples, 3, 3) points that swing smoothly, by metres."""
    time = np.arange(samples)[:, None, None] * 0.01
    frequency, phase = rng.uniform(0.2, 2.0, (3, 3)), rng.uniform(0, 6, (3, 3))
    return np.sin(2 * np.pi * frequency * time + phase)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(draws.seed())


def test_it_is_found_beside_motion_a_thousand_times_larger(rng: np.random.Generator) -> None:
    sigma = 10 ** rng.uniform(-3, -2)
    points = moving(rng) + rng.normal(0, sigma, (400, 3, 3))
    assert noise_floor([points]) == pytest.approx(sigma, rel=0.1)


def test_gaps_and_leaps_do_not_change_it_much(rng: np.random.Generator) -> None:
    points = moving(rng) + rng.normal(0, 0.005, (400, 3, 3))
    points[rng.random((400, 3)) < 0.05] = np.nan
    points[rng.integers(0, 400, 3)] += 0.5
    assert noise_floor([points]) == pytest.approx(0.005, rel=0.15)


def test_too_few_samples_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(DataError, match="differences over 5 samples in a row, got"):
        noise_floor([moving(rng, 6)])
