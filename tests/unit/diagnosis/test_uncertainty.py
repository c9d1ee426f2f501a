"""How sure values are that were fitted."""

from flywheel.diagnosis.checks.uncertainty import uncertainty
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.statistics import INTERVAL
from flywheel.dynamics.plant import Plant
from flywheel.effects import NAMED, Term
from flywheel.robots import load_robot
from tests.unit.diagnosis.conftest import recorded


def test_a_fit_that_ended_before_its_minimum_is_as_unsure_as_it_is_far_from_there(seed):
    robot = load_robot("platform4")
    hidden = (Term(NAMED["winch_gain"], None, (0.1,)),)
    windows = Windows.cut(robot, [recorded(robot, hidden, seed)], seconds=0.4)
    fitter = fitter_of(windows, Plant(robot))
    begun = fitter.with_terms(fitted(fitter, rounds=2), hidden)
    fit = fitter.fit(begun, fitter.free(hidden), rounds=20)
    (value,), (sure,) = fit.terms[0].values, uncertainty(fitter, fit).deviations
    assert abs(value - 0.1) < 4.0 * sure, seed
    off = 20.0 * sure
    stopped = fitter.with_terms(fit, (Term(NAMED["winch_gain"], None, (value + off,)),))
    stopped = fitter.fit(stopped, rounds=20)  # initial states make up for it as far as they can
    (unsure,) = uncertainty(fitter, stopped).deviations
    assert 0.7 * off < unsure < 2.0 * off, seed


def test_an_interval_holds_what_costs_no_more_than_a_fit_is_known_to(seed: int) -> None:
    """Five standard deviations cost 25; of a number that is known beforehand no more is doubted."""
    robot = load_robot("platform4")
    asked = Term(NAMED["winch_gain"], None, (0.1,))
    number = Term(NAMED["cable_damping"], None, (0.0,), (0.3,))
    windows = Windows.cut(robot, [recorded(robot, (asked,), seed)], seconds=0.4)
    fitter = fitter_of(windows, Plant(robot))
    fit = fitter.with_terms(fitted(fitter, rounds=2), (asked, number))
    fit = fitter.fit(fit, fitter.free(fit.terms), rounds=20)
    sure = uncertainty(fitter, fit).deviations
    rough = uncertainty(fitter, fit, known_to=25.0).deviations
    assert 2.0 * sure[0] < rough[0] <= 5.0 / INTERVAL * sure[0], seed
    assert rough[1] == sure[1]
    assert (uncertainty(fitter, fit, known_to=0.1).deviations == sure).all()
