"""Fits and the projected score test."""

from __future__ import annotations

from dataclasses import astuple, replace
from itertools import pairwise

import numpy as np
import pytest

from flywheel.diagnosis.fitting import least_squares as fit_module
from flywheel.diagnosis.fitting.baseline import fitted, fitter_of
from flywheel.diagnosis.fitting.jacobian_cache import Held, Linear
from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.parameters import free_values
from flywheel.diagnosis.fitting.plant_fit import StartFitter
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection import score_test as score
from flywheel.diagnosis.selection.candidates import Candidate, candidates
from flywheel.diagnosis.selection.score_test import Projection, score_test
from flywheel.dynamics.plant import Plant, between, moved
from flywheel.effects import EFFECTS, Scales, Term
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded


@pytest.fixture(scope="module")
def fit(fitter: StartFitter) -> Fit:
    return fitted(fitter, rounds=2)


@pytest.fixture(scope="module")
def library(robot: Robot) -> tuple[Candidate, ...]:
    few = ("cable_friction", "payload", "slope", "command_delay")
    return candidates(robot, {name: EFFECTS[name] for name in few})


@pytest.mark.parametrize("many", [1, 2])
def test_sensitivities_to_many_sizes_are_held_between_two_linearisations(
    fitter: StartFitter, seed: int, monkeypatch, many: int
) -> None:
    monkeypatch.setattr(fit_module, "MANY", many)
    gain = float(np.random.default_rng(seed).uniform(0.05, 0.15))
    terms = (Term(EFFECTS["winch_gain"], None, (gain,)),)
    free = free_values(terms, Scales.of(fitter.windows.robot))
    begun = fitter.beginning(terms)
    begun = replace(begun, held=Held.fresh(fitter.linear(begun)))
    asked, steps = [], []
    by_size, improved = fitter.by_size, fitter.improved
    monkeypatch.setattr(fitter, "by_size", lambda *a: asked.append(a) or by_size(*a))
    monkeypatch.setattr(fitter, "improved", lambda *a: steps.append(a) or improved(*a))
    after = fitter.refit(begun, free, rounds=2)
    assert len(steps) == 2, seed
    assert len(asked) == (1 if many == 1 else 2)
    assert after.cost < begun.cost, seed


def test_what_was_moved_is_what_lies_between(fitter: StartFitter, seed: int) -> None:
    rng = np.random.default_rng(seed)
    position, velocity = rng.normal(0, 0.3, (2, len(fitter.first.qpos), fitter.first.qvel.shape[1]))
    plant = fitter.predictor.plant
    there = moved(plant, fitter.first, position, velocity)
    found = between(plant, fitter.first, there)
    assert np.allclose(found[0], position, atol=1e-9)
    assert np.allclose(found[1], velocity, atol=1e-12)


def test_the_true_plant_is_fitted_down_to_the_noise(
    fitter: StartFitter, fit: Fit, seed: int
) -> None:
    # What is estimated from so short a log may be a sixth off.
    true = 0.001 * fitter.windows.robot.length
    squares = fitter.mean_squares(fit) * (fitter.windows.sigma / true) ** 2
    assert (squares < 1.3).all(), seed
    assert fit.cost < fitter.beginning().cost


def test_a_fit_ends_where_a_round_with_new_sensitivities_does_not_bring_enough(
    fitter: StartFitter, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    begun = fitter.beginning()
    bent = begun.change + 0.3 * fitter.prior * rng.choice([-1.0, 1.0], begun.change.shape)
    begun = fitter.at(bent, begun.starts.winch, ())
    once = fitter.fit(begun, rounds=1)
    fall = begun.cost - once.cost
    assert fall > 0.0 and not once.converged, seed
    enough, more = (fitter.fit(begun, rounds=8, enough=share * fall) for share in (0.99, 1.01))
    assert more.converged and more.cost == once.cost, seed
    assert enough.cost < more.cost, seed


def test_only_stale_sensitivities_are_computed_anew(
    fitter: StartFitter, fit: Fit, seed: int
) -> None:
    nothing = Linear(*(np.zeros_like(part) for part in astuple(fitter.linear(fit))))
    stale = np.zeros(len(fit.change), bool)
    stale[seed % len(stale)] = True
    begun = replace(fit, held=Held(nothing, stale, np.ones(len(stale))))
    renewed = fitter.renewed(begun)
    assert not renewed.stale.any()
    now = fitter.linear(begun, precise=False)
    for part, whole in zip(astuple(renewed.linear), astuple(now), strict=True):
        assert np.allclose(part[stale], whole[stale], rtol=1e-6, atol=1e-6), seed
        assert not part[~stale].any()


def test_windows_that_go_otherwise_than_their_sensitivities_said_become_stale(
    fitter: StartFitter, seed: int
) -> None:
    begun, wrong = fitter.beginning(), seed % len(fitter.windows)
    linear = fitter.linear(begun)
    by_start = linear.by_start.copy()
    by_start[wrong] *= 10.0  # that window goes a tenth of the way that it is promised
    held = Held.fresh(Linear(by_start, linear.by_winch))
    after = fitter.improved(replace(begun, held=held), (), fitter.by_size(begun, ()))
    assert after is not None and after.held is not None
    assert after.held.stale[wrong], seed


def test_differences_are_taken_with_other_steps_the_next_time(
    fitter: StartFitter, fit: Fit
) -> None:
    stale = np.ones(len(fit.change), bool)
    held = Held.fresh(fitter.linear(fit))
    found = []
    for _ in range(4):
        held = fitter.renewed(replace(fit, held=held | stale))
        found.append(held.linear.by_start)
    assert not any(np.array_equal(a, b) for a, b in pairwise(found))
    assert np.array_equal(found[0], found[3])  # and then the same ones again


@pytest.mark.parametrize("name", ["cable_friction", "hysteresis", "torque_speed", "command_delay"])
def test_a_step_ends_at_what_its_unknowns_predict(
    robot: Robot, fitter: StartFitter, seed: int, name: str
) -> None:
    # whether its windows were simulated beside each other, as trials, or one after the other
    (candidate,) = candidates(robot, {name: EFFECTS[name]})
    first = fitter.beginning((candidate.term((0.5,)),))
    # off their places, or windows might as well stay where they are
    off = np.random.default_rng(seed).normal(0.0, 0.05, first.change.shape)
    begun = fitter.at(off, first.starts.winch, first.terms)
    free = free_values(begun.terms, Scales.of(robot))
    after = fitter.improved(
        replace(begun, held=fitter.renewed(begun)), free, fitter.by_size(begun, free)
    )
    assert after is not None and after.cost < begun.cost, seed
    again = fitter.at(after.change, after.starts.winch, after.terms)
    assert (after.change != begun.change).any(), seed
    assert np.array_equal(after.points, again.points)
    assert after.cost == again.cost
    assert np.array_equal(after.carried.winch, again.carried.winch)


def test_new_sensitivities_begin_with_bold_steps(fitter: StartFitter, fit: Fit) -> None:
    count = len(fit.change)
    timid = Held(fitter.linear(fit), np.ones(count, bool), np.full(count, 1e3), common=5)
    renewed = fitter.renewed(replace(fit, held=timid))
    assert renewed.tried == [0, 4, 5]  # bold first, then as the last time
    assert (renewed.own < timid.own).all()


def test_a_window_that_does_not_move_is_damped_more(fitter: StartFitter, seed: int) -> None:
    begun, wrong = fitter.beginning(), seed % len(fitter.windows)
    linear = fitter.linear(begun)
    by_start = linear.by_start.copy()
    by_start[wrong] *= -0.1  # far the wrong way: a short one may come down behind some contact
    held = Held.fresh(Linear(by_start, linear.by_winch))
    after = fitter.stepped(begun, held, begun.residual, begun.starts.winch, ())
    assert after.held is not None
    assert np.array_equal(after.change[wrong], begun.change[wrong]), seed
    assert after.held.own[wrong] > held.own[wrong]
    assert (after.change != begun.change).any(axis=1).sum() >= len(begun.change) - 1
    assert after.cost < begun.cost


def test_of_two_fits_each_window_takes_the_better_start(
    fitter: StartFitter, fit: Fit, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    off = rng.normal(0.0, 0.05, fit.change.shape)
    half = rng.permutation(len(off)) % 2 == 0
    first, second = (
        fitter.at(fit.change + off * worse[:, None], fit.starts.winch, ())
        for worse in (half, ~half)
    )
    mixed = fitter.best_of(first, second)
    assert np.isclose(mixed.cost, fit.cost, rtol=1e-3), seed
    assert mixed.cost < min(first.cost, second.cost)
    assert fitter.best_of(fit, first) is fit


def test_a_projection_takes_out_what_starts_explain(fitter: StartFitter, fit: Fit) -> None:
    linear = fitter.linear(fit)
    projection = Projection.of(fitter, linear, None, np.ones(len(fit.change)))
    after = np.linalg.norm(projection(linear.by_start), axis=0)
    # all but what contradicts the priors, which are the last rows of what is projected on
    assert (after < 1.01 * np.sqrt(len(fit.change)) / fitter.prior).all()
    assert (after < np.linalg.norm(linear.by_start, axis=(0, 1))).all()


def test_a_planted_sensitivity_is_found_with_its_size(
    fitter: StartFitter, fit: Fit, library: tuple[Candidate, ...], seed: int
) -> None:
    test = score_test(fitter, fit, library)
    rng = np.random.default_rng(seed)
    for index in rng.permutation(len(library))[:4]:
        candidate = library[index]
        column = test.columns[:, test.slices[index][0]][:, 0]
        strength = 40.0 / np.linalg.norm(column)  # forty sigmas
        scores = test.scores(strength * column)
        best = max(scores, key=lambda s: s.power)
        assert scores[index].power == pytest.approx(best.power, rel=1e-6), (seed, candidate.label)
        assert scores[index].sizes[0] == pytest.approx(strength, rel=1e-6)
        assert scores[index].power == pytest.approx(1600.0, rel=1e-6)


def test_of_two_secants_the_one_that_promises_more_counts(
    fitter: StartFitter, fit: Fit, library: tuple[Candidate, ...], seed: int, monkeypatch
) -> None:
    """Of all effects here, however little they move; one of them goes the way of its shorter secant."""
    chosen = library[seed % len(library)]
    (column,) = np.moveaxis(fitter.columns(fit, [(*fit.terms, chosen.unit_terms(0.1)[0])]), 2, 0)
    off = replace(fit, residual=40.0 * column / np.linalg.norm(column))  # forty sigmas

    def powers(large: float, share: float) -> list[float]:
        monkeypatch.setattr(score, "LARGE", large)
        monkeypatch.setattr(score, "SHARE", share)
        return [each.power for each in score_test(fitter, off, library).scores()]

    whole, both, same = powers(np.inf, 0.1), powers(0.0, 0.1), powers(0.0, 1.0)
    assert np.allclose(same, whole, rtol=1e-6)
    assert all(b >= w - 1e-6 for b, w in zip(both, whole, strict=True)), seed
    here = seed % len(library)
    assert both[here] > whole[here] + 1e-6, (seed, chosen.label)


def test_a_one_sided_effect_cannot_explain_its_opposite(
    fitter: StartFitter, fit: Fit, library: tuple[Candidate, ...]
) -> None:
    test = score_test(fitter, fit, library)
    assert library[0].effect.sizes[0].one_sided
    column = test.columns[:, test.slices[0][0]][:, 0]
    assert test.scores(-column)[0].power == 0.0


def test_windows_beside_each_other_are_those_one_after_the_other(
    fitter: StartFitter, fit: Fit, library: tuple[Candidate, ...], seed: int
) -> None:
    """Where nothing but the winches goes on from window to window."""
    predictor, rng = fitter.predictor, np.random.default_rng(seed)
    starts = replace(fit.starts, winch=rng.normal(0, 0.01, fit.starts.winch.shape))
    terms = [(), *((c.term(c.typical, 0),) for c in library)]
    points, carried = predictor.chained(starts, terms)
    expected, began = predictor._one_after_the_other(starts, terms)
    off = np.abs(points - expected)
    # Friction and contacts magnify rounding, from 1e-15 to millimetres and more in forty steps.
    assert off[:, :, :8].max() < 1e-9, seed
    assert np.quantile(off, 0.8) < 1e-9, seed
    for one, other in zip(carried, began, strict=True):
        np.testing.assert_allclose(one.winch, other.winch, atol=1e-12)


def test_windows_that_go_on_from_the_one_before_are_not_set_beside_it(
    fitter: StartFitter, fit: Fit, robot: Robot
) -> None:
    names = ("torque_speed", "creep", "cable_damping")
    library = candidates(robot, {name: EFFECTS[name] for name in names})
    terms = [(c.term(c.typical, 0),) for c in library]
    predictor = fitter.predictor
    assert [predictor.apart(each) for each in terms] == [False, False, True]
    _, (slower, creeping, damped) = predictor.chained(fit.starts, terms)
    assert creeping.memory["creep"][1:].any()
    assert not damped.memory
    # In one of seventy recordings no winch reels in under load: nothing to be seen of it being slower.
    _, (expected,) = predictor._one_after_the_other(fit.starts, terms[:1])
    assert np.array_equal(slower.winch, expected.winch)
    # Here one does.
    known = fitter_of(Windows.cut(robot, [recorded(robot, (), 1)], 0.4), predictor.plant)
    _, (slower, _, damped) = known.predictor.chained(known.beginning().starts, terms)
    assert np.abs(slower.winch - damped.winch).max() > 1e-9


def test_a_window_by_itself_that_began_in_a_wrong_place_begins_elsewhere(
    robot: Robot, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    alone = fitter_of(Windows.cut(robot, [recorded(robot, (), seed)], seconds=10.0), Plant(robot))
    assert len(alone.windows) == 1
    right = alone.beginning()
    wrong = alone.at(
        right.change + rng.choice((-1.0, 1.0), right.change.shape), right.starts.winch, ()
    )
    assert alone.elsewhere(wrong).cost < 0.5 * wrong.cost, seed
