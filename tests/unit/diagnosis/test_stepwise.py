"""Where models with further effects begin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flywheel.diagnosis import diagnose
from flywheel.diagnosis.fitting.baseline import baseline_fit, fitted, fitter_of
from flywheel.diagnosis.fitting.least_squares import LITTLE, Fit
from flywheel.diagnosis.fitting.multistart import eased
from flywheel.diagnosis.fitting.parameters import free_values
from flywheel.diagnosis.fitting.plant_fit import StartFitter
from flywheel.diagnosis.fitting.stopping import HOPE
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.stepwise import LAST_HOPE, MOST, SLIGHT, Selection
from flywheel.dynamics.plant import Plant
from flywheel.effects import NAMED, Term
from flywheel.errors import DataError
from flywheel.records import Observation, Trajectory
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded


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
    free = free_values(terms, selection.scales)
    straight, recovered = (
        fitter.fit(selection.begun(each, terms), free, rounds=1)
        for each in (step, replace(step, fit=astray))
    )
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


def flickering(log: Trajectory, point: int, way: float) -> Trajectory:
    """A recording in which a marker leaps to and fro by `way` [m], which no motion looks like."""
    points = log.observations.points.copy()
    points[50:60, point] += way * (-1.0) ** np.arange(10)[:, None]
    return Trajectory(Observation(points, log.observations.winch), log.controls, log.dt)


def test_nothing_is_added_that_explains_next_to_nothing_of_what_is_left(
    robot: Robot, seed: int
) -> None:
    gain = NAMED["winch_gain"]
    right = recorded(robot, (Term(gain, None, (0.3,)),), seed)
    wrong = flickering(recorded(robot, (), seed), seed % len(robot.points), 0.2 * robot.length)
    library = candidates(robot, {"winch_gain": gain, "slope": NAMED["slope"]})
    steps = {}
    for name, recording in (("right", right), ("wrong", wrong)):
        fitter = fitter_of(Windows.cut(robot, [recording], seconds=0.4), Plant(robot))
        steps[name] = Selection(fitter, library, 25.0).look(fitted(fitter))
    assert steps["right"].explained(SLIGHT), seed
    assert steps["right"].scores[0].candidate.effect is gain, seed
    assert not steps["wrong"].explained(SLIGHT), seed


@pytest.mark.parametrize(("room", "finds"), [(1, False), (MOST, True)])
def test_rivals_for_the_last_effect_that_may_be_added_are_given_up_sooner(
    robot: Robot, seed: int, monkeypatch, room: int, finds: bool
) -> None:
    """A rival that comes nearer by 0.6 of the last round's fall in each, until it is just the better one."""
    hidden = (Term(NAMED["winch_gain"], None, (0.3,)),)
    fitter = fitter_of(
        Windows.cut(robot, [recorded(robot, hidden, seed)], seconds=0.4), Plant(robot)
    )
    library = candidates(robot, {"winch_gain": hidden[0].effect})
    selection = Selection(fitter, library, 25.0)
    step = selection.look(fitted(fitter))
    races: list[float] = []

    def race(begun, hope=HOPE):
        races.append(hope)
        return list(begun)

    monkeypatch.setattr(selection, "race", race)
    selection._next(step, room)
    (hope,) = races
    assert hope == (HOPE if finds else LAST_HOPE)

    fall = float(np.random.default_rng(seed).uniform(50.0, 500.0))
    falls = [fall * 0.6**number for number in range(10)]
    target = selection.criterion(step.fit) - 0.99 * sum(falls)

    def fit(before: Fit, free, rounds: int, enough: float) -> Fit:
        del free, rounds, enough
        return replace(before, cost=before.cost - falls.pop(0))

    monkeypatch.setattr(fitter, "fit", fit)
    rival = selection.pursued(replace(step.fit, converged=False), target, hope)
    assert (selection.criterion(rival) < target) == finds, seed


def test_a_model_that_is_clearly_wrong_is_not_fitted_to_the_last_digit(
    robot: Robot, seed: int, monkeypatch
) -> None:
    right = recorded(robot, (), seed)
    wrong = flickering(right, seed % len(robot.points), 0.2 * robot.length)
    asked: dict[str, list[float]] = {}
    for name, recording in (("right", right), ("wrong", wrong)):
        fitter = fitter_of(Windows.cut(robot, [recording], seconds=0.4), Plant(robot))
        begun, fit = fitter.beginning(), fitter.fit
        falls = asked[name] = []

        def spied(before: Fit, *args, enough: float, fit=fit, falls=falls, **options) -> Fit:
            falls.append(enough)
            return fit(before, *args, enough=enough, **options)

        monkeypatch.setattr(fitter, "fit", spied)
        Selection(fitter, (), 25.0).pursued(begun)
    assert min(asked["wrong"]) > LITTLE, seed
    assert asked["right"][-1] < 0.1 * min(asked["wrong"]), seed


def test_the_loudest_window_alone_begins_elsewhere(fitter: StartFitter, seed: int) -> None:
    fit = fitted(fitter, rounds=1)
    rng = np.random.default_rng(seed)
    bent = fit.change + 3.0 * fitter.prior * rng.choice([-1.0, 1.0], fit.change.shape)
    astray = fitter.at(bent, fit.starts.winch, ())
    for most, expected in ((1, 1), (None, len(bent))):
        found = fitter.elsewhere(astray, seed, usual=1.0, most=most)
        moved = (found.change != bent).any(axis=1)
        assert moved.sum() == expected, seed
        assert moved[fitter.mean_squares(astray).argmax()], seed


def test_windows_that_saw_nothing_do_not_silence_those_that_did(robot: Robot, seed: int) -> None:
    log = recorded(robot, (Term(NAMED["winch_gain"], None, (0.3,)),), seed)
    points = log.observations.points.copy()
    points[21:] = np.nan  # of three windows nothing but where one begins
    dark = replace(log, observations=replace(log.observations, points=points))
    fitter = fitter_of(Windows.cut(robot, [dark], seconds=0.2), Plant(robot))
    assert len(fitter.windows) == 4
    step = Selection(fitter, candidates(robot, {"winch_gain": NAMED["winch_gain"]}), 25.0).look(
        fitter.beginning()
    )
    assert step.test.projection.weights[0] == 1.0, seed
    assert step.test.noise > 0.01, seed


def test_recordings_in_other_control_steps_than_the_plant_are_refused(
    robot: Robot, trajectory: Trajectory
) -> None:
    with pytest.raises(DataError, match="control steps of 0.02 s, the plant in steps of 0.01 s"):
        diagnose(Plant(robot), [replace(trajectory, dt=0.02)])


@pytest.mark.parametrize("stuck", [False, True])
def test_a_further_effect_promises_more_than_a_stuck_fit_may_win_by_chance(
    fitter: StartFitter, robot: Robot, seed: int, stuck: bool
) -> None:
    step = Selection(fitter, candidates(robot, {"winch_gain": NAMED["winch_gain"]}), 25.0).look(
        fitted(fitter, rounds=2)
    )
    score = replace(step.scores[0], power=float(np.random.default_rng(seed).uniform(30.0, 90.0)))
    left = score.power * (11.0 if stuck else 9.0)
    test = replace(step.test, noise=0.99)  # nothing is left, says the linearisation
    fit = replace(step.fit, cost=test.freedom + left)
    assert replace(step, fit=fit, test=test, scores=(score,)).explained(SLIGHT) is not stuck, seed


def test_of_models_that_are_one_by_several_names_one_is_fitted(
    robot: Robot, fitter: StartFitter, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("command_delay", "sensor_latency", "winch_gain")
    library = candidates(robot, {name: NAMED[name] for name in names})
    selection = Selection(fitter, library, 25.0)
    begun = fitted(fitter, rounds=1)
    late = float(np.random.default_rng(seed).uniform(0.005, 0.03))
    models = [fitter.under(begun, (Term(NAMED[name], None, (late,)),)) for name in names]
    assert models[0].cost == pytest.approx(models[1].cost, rel=1e-9), seed
    pursued: list[str] = []

    def pursue(fit: Fit, *_: float, **__: float) -> Fit:
        pursued.append(fit.terms[0].effect.name)
        return fit

    monkeypatch.setattr(selection, "pursued", pursue)
    selection.race(models)
    assert "winch_gain" in pursued and len({*names[:2]} & {*pursued}) == 1, (seed, pursued)


def test_what_promised_the_most_and_is_not_ahead_begins_elsewhere_first(
    fitter: StartFitter, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    ahead, behind = fitted(fitter, rounds=2), fitter.beginning()
    assert ahead.cost < behind.cost, seed
    selection, freed = Selection(fitter, (), 25.0), replace(ahead, cost=0.5 * ahead.cost)
    begun: list[Fit] = []

    def elsewhere(fit: Fit, *_: object, **__: object) -> Fit:
        begun.append(fit)
        return freed if fit is behind else fit

    monkeypatch.setattr(fitter, "elsewhere", elsewhere)
    monkeypatch.setattr(selection, "pursued", lambda fit, *_, **__: fit)
    monkeypatch.setattr(selection, "_stepped", lambda fit: fit)
    assert selection.race([behind, ahead])[0] is freed
    assert begun[0] is behind
    begun.clear()
    assert selection.race([ahead, behind])[0] is ahead
    assert not any(fit is behind for fit in begun)


def test_windows_of_a_model_that_is_wrong_otherwise_do_not_all_begin_elsewhere(
    robot: Robot, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = recorded(robot, (), seed)
    wrong = flickering(right, seed % len(robot.points), 0.2 * robot.length)
    for recording, starts_are_wrong in ((right, True), (wrong, False)):
        fitter = fitter_of(Windows.cut(robot, [recording], seconds=0.4), Plant(robot))
        fit, asked, search = fitted(fitter), [], fitter.elsewhere
        if starts_are_wrong:
            fit = fitter.at(fit.change + 3.0 * fitter.prior, fit.starts.winch, ())

        def elsewhere(*args, most=None, asked=asked, search=search, **options) -> Fit:
            asked.append(most)
            return search(*args, most=most, **options)

        monkeypatch.setattr(fitter, "elsewhere", elsewhere)
        found = eased(fitter, fit, seed, usual=1.0)
        assert asked == ([1, None] if starts_are_wrong else [1]), seed
        assert (found is not fit) == starts_are_wrong, seed


def test_a_model_that_is_clearly_wrong_begins_elsewhere_in_its_loudest_window_first(
    fitter: StartFitter, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, asked = fitter.beginning(), []

    def elsewhere(fit: Fit, *_: object, most: int | None = None, **__: object) -> Fit:
        asked.append(most)
        return fit

    monkeypatch.setattr(fitter, "elsewhere", elsewhere)
    monkeypatch.setattr(Selection, "pursued", lambda *_: pytest.fail("nothing has changed"))
    for times_noise in (2.0, 1.0):
        fit = replace(begun, cost=times_noise * fitter.freedom(begun))
        assert Selection(fitter, (), 25.0)._from_elsewhere(fit) is fit
    assert asked == [1, None]


def test_a_baseline_that_is_clearly_wrong_is_not_fitted_to_the_last_digit(
    fitter: StartFitter, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, asked, worth = fitter.beginning(), [], []

    def elsewhere(fit: Fit, *_: object, most: int | None = None, **__: object) -> Fit:
        asked.append(most)
        return fit

    def fit(begun: Fit, *_: object, enough: float = 0.0, **__: object) -> Fit:
        worth.append(enough)
        return begun

    monkeypatch.setattr(fitter, "elsewhere", elsewhere)
    monkeypatch.setattr(fitter, "fit", fit)
    monkeypatch.setattr(fitter, "coarse", lambda fit, _: np.zeros(len(fit.change), bool))
    for times_noise in (2.0, 1.0):
        cost = times_noise * fitter.freedom(begun)
        assert baseline_fit(fitter, replace(begun, cost=cost))[1].cost == cost
    assert asked == [1, None]
    assert [each > 0.0 for each in worth] == [False, True, False, False]  # before, after; twice


def test_a_model_that_diverges_is_given_up_after_a_round(
    fitter: StartFitter, monkeypatch: pytest.MonkeyPatch
) -> None:
    selection = Selection(fitter, (), 25.0)
    diverged = replace(fitter.beginning(), cost=np.inf)
    rounds: list[Fit] = []

    def fit(begun: Fit, *_: object, **__: object) -> Fit:
        rounds.append(begun)
        return begun

    monkeypatch.setattr(selection.fitter, "fit", fit)
    assert selection.pursued(diverged) is diverged and len(rounds) == 1


def test_other_values_of_what_a_plant_had_are_an_answer_and_better_starts_are_none(
    robot: Robot, fitter: StartFitter, monkeypatch: pytest.MonkeyPatch
) -> None:
    (candidate,) = candidates(robot, {"winch_gain": NAMED["winch_gain"]})
    selection = Selection(fitter, (candidate,), 25.0)
    plain = selection.look(fitted(fitter, rounds=1))
    had, half = (candidate.term((0.1,)),), 0.5 * plain.fit.cost
    for terms, fall, expected in ((had, half, 2), (had, 0.1, 1), ((), half, 1)):
        first = replace(plain, fit=replace(plain.fit, terms=terms))
        better = iter([replace(first.fit, cost=first.fit.cost - fall), None])
        monkeypatch.setattr(selection, "_moved", lambda _: None)
        monkeypatch.setattr(selection, "_next", lambda *_, found=better: next(found))
        monkeypatch.setattr(selection, "look", lambda fit, at=first: replace(at, fit=fit))
        assert len(selection._run(first)) == expected
