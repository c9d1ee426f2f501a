"""Values and steps within bounds."""

import numpy as np
import pytest

from flywheel.diagnosis.fitting.least_squares import damped_step
from flywheel.diagnosis.fitting.nuisance import unsure_terms
from flywheel.diagnosis.fitting.parameters import FreeParameter, free_parameters
from flywheel.diagnosis.settings import FittingSettings
from flywheel.effects import Scales

OPEN = np.array([[-np.inf], [np.inf]])


def normal(seed: int, size: int = 6) -> tuple[np.ndarray, np.ndarray, np.random.Generator]:
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(3 * size, size))
    return columns.T @ columns, rng.normal(size=size), rng


def test_a_step_that_no_bound_is_in_the_way_of_solves_the_normal_equations(seed: int) -> None:
    matrix, pull, _ = normal(seed)
    step = damped_step(matrix, pull, 0.0, np.repeat(OPEN, len(pull), axis=1))
    np.testing.assert_allclose(matrix @ step, pull, atol=1e-6)


def test_a_step_that_would_leave_its_bounds_ends_at_them_and_the_others_make_up_for_it(seed):
    matrix, pull, rng = normal(seed)
    whole, one = np.linalg.solve(matrix, pull), int(rng.integers(len(pull)))
    bounds = np.repeat(OPEN, len(pull), axis=1)
    bounds[:, one] = sorted((0.0, 0.5 * whole[one]))
    step = damped_step(matrix, pull, 0.0, bounds)
    assert step[one] == pytest.approx(0.5 * whole[one]), seed
    others = np.arange(len(pull)) != one
    np.testing.assert_allclose((matrix @ step - pull)[others], 0.0, atol=1e-6)


def test_what_is_said_of_a_number_is_believed_up_to_three_deviations(robot, seed):
    deviation = float(np.random.default_rng(seed).uniform(0.01, 0.1))
    terms = unsure_terms({"body_mass": deviation})
    (free,) = free_parameters(terms, Scales.of(robot))
    for way in (-1.0, 1.0):
        ((value,),) = (term.values for term in free.moved(terms, way * 1e3))
        assert value == pytest.approx(way * FittingSettings().believed * deviation), seed


@pytest.mark.parametrize(
    ("value", "low", "high", "step"),
    [
        (0.0, 0.0, 4.0, 0.25),
        (4.0, 0.0, 4.0, -0.25),
        (0.0, -0.1, 0.1, 0.1),
        (0.05, -0.1, 0.1, -0.15),
    ],
)
def test_a_difference_stays_within_bounds(robot, value, low, high, step):
    terms = unsure_terms({"body_mass": 1.0})
    free = FreeParameter(0, 0, 1.0, low, high, step=0.25)
    assert free.step_from(free.moved(terms, value)) == pytest.approx(step)
