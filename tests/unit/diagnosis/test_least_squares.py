"""Fits by nonlinear least squares, and the score test around them."""

from dataclasses import astuple, replace
from itertools import pairwise

import numpy as np
import pytest

from flywheel.diagnosis.fitting import least_squares
from flywheel.diagnosis.fitting.least_squares import Fit, Jacobian, JacobianCache, Restart
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.projection import Projection
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import Candidate, candidates
from flywheel.diagnosis.selection.scores import score_test
from flywheel.dynamics.plant import Plant, between, moved
from flywheel.effects import EFFECTS, Term
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded


@pytest.fixture(scope="module")
def fit(fitter: PlantFitter) -> Fit:
    return fitted(fitter, rounds=2)


@pytest.fixture(scope="module")
def library(robot: Robot) -> tuple[Candidate, ...]:
    few = ("cable_friction", "payload", "slope", "command_delay")
    return candidates(robot, {name: EFFECTS[name] for name in few})


@pytest.mark.parametrize("many", [1, 2])
def test_sensitivities_to_many_values_are_kept_until_the_next_jacobian(
    fitter: PlantFitter, seed: int, monkeypatch, many: int
) -> None:
    monkeypatch.setattr(least_squares, "MANY", many)
    monkeypatch.setattr(least_squares, "STEPS", 2)
    fitter = PlantFitter(fitter.simulator, fitter.first)
    gain = float(np.random.default_rng(seed).uniform(0.05, 0.15))
    begun = fitter.first_estimate((Term(EFFECTS["winch_gain"], None, (gain,)),))
    begun = replace(begun, cache=fitter.cached(fitter.jacobian(begun)))
    asked, steps = [], []
    by_value, step = fitter.by_value, fitter._step
    monkeypatch.setattr(fitter, "by_value", lambda *a: asked.append(a) or by_value(*a))
    monkeypatch.setattr(fitter, "_step", lambda *a: steps.append(a) or step(*a))
    after = fitter.lm_steps(begun, fitter.free(begun.terms))
    assert len(steps) == 2, seed
    assert len(asked) == (1 if many == 1 else 2)
    assert after.cost < begun.cost, seed


@pytest.mark.parametrize(("many", "taken"), [(1, 80.0), (9, 90.0)])
def test_many_values_take_the_step_that_suits_them_best_and_few_the_first_that_does(
    fitter: PlantFitter, monkeypatch, many: int, taken: float
) -> None:
    monkeypatch.setattr(least_squares, "MANY", many)
    fitter = PlantFitter(fitter.simulator, fitter.first)
    begun = fitter.first_estimate((Term(EFFECTS["winch_gain"], None, (0.1,)),))
    begun = replace(begun, cache=fitter.cached(fitter.jacobian(begun)), cost=100.0)
    costs = iter([110.0, 90.0, 80.0, 85.0, 10.0])  # from the least damped on

    def stepped(fit: Fit, cache: JacobianCache, *_) -> Fit:
        return replace(fit, cost=next(costs), cache=cache)

    monkeypatch.setattr(fitter, "stepped", stepped)
    free = fitter.free(begun.terms)
    after = fitter._step(begun, free, fitter.by_value(begun, free))
    assert after is not None
    assert after.cost == taken


def test_what_was_moved_is_what_lies_between(fitter: PlantFitter, seed: int) -> None:
    rng = np.random.default_rng(seed)
    position, velocity = rng.normal(0, 0.3, (2, len(fitter.first.qpos), fitter.first.qvel.shape[1]))
    plant = fitter.simulator.plant
    there = moved(plant, fitter.first, position, velocity)
    found = between(plant, fitter.first, there)
    assert np.allclose(found[0], position, atol=1e-9)
    assert np.allclose(found[1], velocity, atol=1e-12)


@pytest.mark.slow
def test_the_true_plant_is_fitted_down_to_the_noise(fitter, fit, seed):
    # The noise, estimated from so short a recording, may be a sixth off.
    true = 0.001 * fitter.windows.robot.length
    squares = fitter.mean_squares(fit) * (fitter.windows.sigma / true) ** 2
    assert (squares < 1.3).all(), seed
    assert fit.cost < fitter.first_estimate().cost


def test_a_fit_ends_where_a_round_with_a_new_jacobian_does_not_bring_enough(fitter, seed):
    rng = np.random.default_rng(seed)
    begun = fitter.first_estimate()
    bent = begun.local + 0.3 * fitter.local_prior * rng.choice([-1.0, 1.0], begun.local.shape)
    begun = fitter.at(bent, begun.initial.winch, ())
    once = fitter.fit(begun, rounds=1)
    fall = begun.cost - once.cost
    assert fall > 0.0 and not once.converged, seed
    enough, more = (fitter.fit(begun, rounds=8, enough=share * fall) for share in (0.99, 1.01))
    assert more.converged and more.cost == once.cost, seed
    assert enough.cost < more.cost, seed


def test_a_jacobian_is_computed_anew_in_stale_windows_only(fitter, fit, seed):
    nothing = Jacobian(*(np.zeros_like(part) for part in astuple(fitter.jacobian(fit))))
    stale = np.zeros(len(fit.local), bool)
    stale[seed % len(stale)] = True
    begun = replace(fit, cache=JacobianCache(nothing, stale, np.ones(len(stale))))
    renewed = fitter.renewed(begun)
    assert not renewed.stale.any()
    now = fitter.rough_jacobian(begun)
    for part, whole in zip(astuple(renewed.jacobian), astuple(now), strict=True):
        assert np.allclose(part[stale], whole[stale], rtol=1e-6, atol=1e-6), seed
        assert not part[~stale].any()


def test_windows_that_change_otherwise_than_their_jacobian_said_become_stale(fitter, seed):
    begun, wrong = fitter.first_estimate(), seed % len(fitter.windows)
    jacobian = fitter.jacobian(begun)
    by_local = jacobian.by_local.copy()
    by_local[wrong] *= 10.0  # that window goes a tenth of the way that it is promised
    cache = fitter.cached(Jacobian(by_local, jacobian.by_winch))
    after = fitter._step(replace(begun, cache=cache), (), fitter.by_value(begun, ()))
    assert after is not None and after.cache is not None
    assert after.cache.stale[wrong], seed


@pytest.mark.slow
def test_differences_are_taken_with_other_steps_the_next_time(fitter, fit):
    stale = np.ones(len(fit.local), bool)
    cache = fitter.cached(fitter.jacobian(fit))
    found = []
    for _ in range(4):
        cache = fitter.renewed(replace(fit, cache=cache.outdated(stale)))
        found.append(cache.jacobian.by_local)
    assert not any(np.array_equal(a, b) for a, b in pairwise(found))
    assert np.array_equal(found[0], found[3])  # and then the same ones again


@pytest.mark.parametrize("name", ["cable_friction", "hysteresis", "torque_speed", "command_delay"])
def test_a_step_ends_at_what_its_parameters_predict(robot, fitter, seed, name):
    # whether its windows were simulated beside each other, as trials, or one after the other
    (candidate,) = candidates(robot, {name: EFFECTS[name]})
    first = fitter.first_estimate((candidate.term((0.5,)),))
    # off their places, or windows might as well stay where they are
    off = np.random.default_rng(seed).normal(0.0, 0.05, first.local.shape)
    begun = fitter.at(off, first.initial.winch, first.terms)
    free = fitter.free(begun.terms)
    after = fitter._step(
        replace(begun, cache=fitter.renewed(begun)), free, fitter.by_value(begun, free)
    )
    assert after is not None and after.cost < begun.cost, seed
    again = fitter.at(after.local, after.initial.winch, after.terms)
    assert (after.local != begun.local).any(), seed
    assert np.array_equal(after.points, again.points)
    assert after.cost == again.cost
    assert np.array_equal(after.carried.winch, again.carried.winch)


def test_a_new_jacobian_begins_with_little_damping(fitter: PlantFitter, fit: Fit) -> None:
    count = len(fit.local)
    stale, damping = np.ones(count, bool), np.full(count, 1e3)
    damped = JacobianCache(fitter.jacobian(fit), stale, damping, shared_damping=5)
    renewed = fitter.renewed(replace(fit, cache=damped))
    assert renewed.tried(6) == [0, 4, 5]  # the least of all first, then as the last time
    assert (renewed.damping < damped.damping).all()


def test_a_window_that_does_not_move_is_damped_more(fitter: PlantFitter, seed: int) -> None:
    begun, wrong = fitter.first_estimate(), seed % len(fitter.windows)
    jacobian = fitter.jacobian(begun)
    by_local = jacobian.by_local.copy()
    by_local[wrong] *= -0.1  # far the wrong way: a short one may come down behind some contact
    cache = fitter.cached(Jacobian(by_local, jacobian.by_winch))
    after = fitter.stepped(begun, cache, begun.residual, begun.initial.winch, ())
    assert after.cache is not None
    assert np.array_equal(after.local[wrong], begun.local[wrong]), seed
    assert after.cache.damping[wrong] > cache.damping[wrong]
    assert (after.local != begun.local).any(axis=1).sum() >= len(begun.local) - 1
    assert after.cost < begun.cost


def test_of_two_fits_each_window_takes_the_better_initial_state(fitter, fit, seed):
    rng = np.random.default_rng(seed)
    off = rng.normal(0.0, 0.05, fit.local.shape)
    half = rng.permutation(len(off)) % 2 == 0
    first, second = (
        fitter.at(fit.local + off * worse[:, None], fit.initial.winch, ())
        for worse in (half, ~half)
    )
    mixed = fitter.best_of(first, second)
    assert np.isclose(mixed.cost, fit.cost, rtol=1e-3), seed
    assert mixed.cost < min(first.cost, second.cost)
    assert fitter.best_of(fit, first) is fit


def test_a_projection_takes_out_what_initial_states_explain(fitter: PlantFitter, fit: Fit) -> None:
    jacobian = fitter.jacobian(fit)
    projection = Projection.of(fitter, jacobian, None, np.ones(len(fit.local)))
    after = np.linalg.norm(projection(jacobian.by_local), axis=0)
    # all but what contradicts the priors, which are the last rows of what is projected on
    assert (after < 1.01 * np.sqrt(len(fit.local)) / fitter.local_prior).all()
    assert (after < np.linalg.norm(jacobian.by_local, axis=(0, 1))).all()


def test_a_planted_sensitivity_is_found_with_its_size(fitter, fit, library, seed):
    test = score_test(fitter, fit, library)
    rng = np.random.default_rng(seed)
    for index in rng.permutation(len(library))[:4]:
        candidate = library[index]
        column = test.columns[:, test.slices[index][0]][:, 0]
        strength = 40.0 / np.linalg.norm(column)  # forty sigmas
        scores = replace(test, residual=strength * column).scores()
        best = max(scores, key=lambda s: s.statistic)
        assert scores[index].statistic == pytest.approx(best.statistic, rel=1e-6), (
            seed,
            candidate.label,
        )
        assert scores[index].sizes[0] == pytest.approx(strength, rel=1e-6)
        assert scores[index].statistic == pytest.approx(1600.0, rel=1e-6)


@pytest.mark.slow
def test_of_two_secants_the_one_that_promises_more_counts(fitter, fit, library, seed, monkeypatch):
    """Of all effects here, however little they move; one of them goes the way of its shorter secant."""
    chosen = library[seed % len(library)]
    (column,) = np.moveaxis(fitter.columns(fit, [(*fit.terms, chosen.unit_terms(0.1)[0])]), 2, 0)
    off = replace(fit, residual=40.0 * column / np.linalg.norm(column))  # forty sigmas

    def statistics(large: float, part: float) -> list[float]:
        monkeypatch.setattr("flywheel.diagnosis.selection.scores.LARGE", large)
        monkeypatch.setattr("flywheel.diagnosis.selection.scores.PART", part)
        test = score_test(fitter, off, library)
        return [score.statistic for score in test.scores()]

    whole, both, same = statistics(np.inf, 0.1), statistics(0.0, 0.1), statistics(0.0, 1.0)
    assert np.allclose(same, whole, rtol=1e-6)
    assert all(b >= w - 1e-6 for b, w in zip(both, whole, strict=True)), seed
    here = seed % len(library)
    assert both[here] > whole[here] + 1e-6, (seed, chosen.label)


def test_a_one_sided_effect_cannot_explain_its_opposite(fitter, fit, library):
    test = score_test(fitter, fit, library)
    assert library[0].effect.sizes[0].one_sided
    column = test.columns[:, test.slices[0][0]][:, 0]
    assert replace(test, residual=-column).scores()[0].statistic == 0.0


def test_where_no_candidate_is_left_none_is_scored(fitter, fit):
    assert fitter.columns(fit, []).shape == (*fit.residual.shape, 0)
    test = score_test(fitter, fit, [])
    assert test.scores() == []


def test_windows_beside_each_other_are_those_one_after_the_other(fitter, fit, library, seed):
    """Where nothing but the winches goes on from window to window."""
    simulator, rng = fitter.simulator, np.random.default_rng(seed)
    initial = replace(fit.initial, winch=rng.normal(0, 0.01, fit.initial.winch.shape))
    terms = [(), *((c.term(c.typical, 0),) for c in library)]
    points, carried = simulator.chained(initial, terms)
    expected, began = simulator._one_after_the_other(initial, terms)
    off = np.abs(points - expected)
    # Friction and contacts magnify rounding, from 1e-15 to millimetres and more in forty steps.
    assert off[:, :, :8].max() < 1e-9, seed
    assert np.quantile(off, 0.8) < 1e-9, seed
    for one, other in zip(carried, began, strict=True):
        np.testing.assert_allclose(one.winch, other.winch, atol=1e-12)


def test_windows_that_go_on_from_the_one_before_are_not_set_beside_it(fitter, fit, robot):
    names = ("torque_speed", "creep", "cable_damping")
    library = candidates(robot, {name: EFFECTS[name] for name in names})
    terms = [(c.term(c.typical, 0),) for c in library]
    simulator = fitter.simulator
    assert [simulator.apart(each) for each in terms] == [False, False, True]
    _, (slower, creeping, damped) = simulator.chained(fit.initial, terms)
    assert creeping.memory["creep"][1:].any()
    assert not damped.memory
    # In one of seventy recordings no winch reels in under load: nothing to be seen of it being slower.
    _, (expected,) = simulator._one_after_the_other(fit.initial, terms[:1])
    assert np.array_equal(slower.winch, expected.winch)
    # Here one does.
    known = fitter_of(Windows.cut(robot, [recorded(robot, (), 1)], 0.4), simulator.plant)
    _, (slower, _, damped) = known.simulator.chained(known.first_estimate().initial, terms)
    assert np.abs(slower.winch - damped.winch).max() > 1e-9


@pytest.mark.slow
def test_a_window_by_itself_with_a_wrong_initial_state_begins_elsewhere(robot, seed):
    rng = np.random.default_rng(seed)
    alone = fitter_of(Windows.cut(robot, [recorded(robot, (), seed)], seconds=10.0), Plant(robot))
    assert len(alone.windows) == 1
    right = alone.first_estimate()
    wrong = alone.at(
        right.local + rng.choice((-1.0, 1.0), right.local.shape), right.initial.winch, ()
    )
    assert alone.restarted(wrong, Restart()).cost < 0.5 * wrong.cost, seed
