"""Where models with further effects begin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flywheel.diagnosis.baseline import fitted
from flywheel.diagnosis.candidates import candidates
from flywheel.diagnosis.free import free_values
from flywheel.diagnosis.selection import Selection
from flywheel.diagnosis.start_fit import StartFitter
from flywheel.effects import NAMED
from flywheel.robots import Robot


def test_a_model_does_not_begin_where_another_one_was_led_astray(
    robot: Robot, fitter: StartFitter, seed: int
) -> None:
    (candidate,) = candidates(robot, {"winch_gain": NAMED["winch_gain"]})
    selection = Selection(fitter, (candidate,), 25.0)
    step = selection.look(fitted(fitter, rounds=1))
    rng = np.random.default_rng(seed)
    bent = step.fit.change + 3.0 * fitter.prior * rng.choice([-1.0, 1.0], step.fit.change.shape)
    astray = replace(fitter.at(bent, step.fit.starts.winch, ()), held=step.fit.held)
    terms = (candidate.term((0.01,)),)
    straight = selection.with_terms(step, terms)
    recovered = selection.with_terms(replace(step, fit=astray), terms)
    assert astray.cost > 10.0 * straight.cost, seed
    assert recovered.cost < 2.0 * straight.cost, seed


def test_sizes_are_made_to_suit_the_first_estimates(
    robot: Robot, fitter: StartFitter, seed: int
) -> None:
    (candidate,) = candidates(robot, {"winch_gain": NAMED["winch_gain"]})
    selection = Selection(fitter, (candidate,), 25.0)
    terms = (candidate.term((float(np.random.default_rng(seed).uniform(1.0, 2.0)),)),)
    begun = fitter.beginning(terms)
    found = fitter.roughly(terms, free_values(terms, selection.scales))
    assert found.cost < begun.cost, seed
    assert np.array_equal(found.change, begun.change), seed  # the starts stay
    assert abs(found.terms[0].values[0]) < 0.5 * terms[0].values[0], seed  # nothing is hidden
