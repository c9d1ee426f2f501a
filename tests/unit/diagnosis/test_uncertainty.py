"""How sure values are that were fitted."""

from __future__ import annotations

from flywheel.diagnosis.checks.uncertainty import uncertainty
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import NAMED, Term
from flywheel.robots import load_robot
from tests.unit.diagnosis.conftest import recorded


def test_a_fit_that_ended_before_its_minimum_is_as_unsure_as_it_is_far_from_there(
    seed: int,
) -> None:
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
