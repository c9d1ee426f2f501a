"""Where models with further effects begin, and how long they are fitted."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from flywheel.diagnosis import diagnose
from flywheel.diagnosis.fitting.least_squares import Fit, Restart
from flywheel.diagnosis.fitting.model import fitted, fitted_as_given, fitter_of
from flywheel.diagnosis.fitting.multistart import restarted_with_care
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.selection.stepwise import _fitted_in_turn, _forward
from flywheel.diagnosis.settings import FitStoppingSettings, SelectionSettings
from flywheel.dynamics.plant import Plant
from flywheel.effects import NAMED, Term
from flywheel.errors import DataError
from flywheel.records import Observation, Trajectory
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded

ROBOT = "platform4"

SELECTION, STOPPING = SelectionSettings(), FitStoppingSettings()
STEPWISE = "flywheel.diagnosis.selection.stepwise"


def test_a_model_does_not_begin_where_another_one_was_led_astray(robot, fitter, seed):
    (candidate,) = candidates(robot, {"winch_gain": NAMED["winch_gain"]})
    search = Search(fitter, (candidate,))
    model = search.score_all(fitted(fitter, rounds=1))
    rng, local = np.random.default_rng(seed), model.fit.local
    bent = local + 3.0 * fitter.local_prior * rng.choice([-1.0, 1.0], local.shape)
    astray = replace(fitter.with_local(model.fit, bent), cache=model.fit.cache)
    terms = (candidate.term((0.01,)),)
    straight, recovered = (
        fitter.fit(search.warm_start(each, terms), fitter.free(terms), rounds=1)
        for each in (model, replace(model, fit=astray))
    )
    assert astray.cost > 10.0 * straight.cost, seed
    assert recovered.cost < 2.0 * straight.cost, seed


def test_values_are_made_to_suit_the_first_estimates(robot, fitter, seed):
    (candidate,) = candidates(robot, {"winch_gain": NAMED["winch_gain"]})
    terms = (candidate.term((float(np.random.default_rng(seed).uniform(1.0, 2.0)),)),)
    begun = fitter.first_estimate(terms)
    found = fitter.rough_estimate(terms, fitter.free(terms))
    assert found.cost < begun.cost, seed
    assert np.array_equal(found.local, begun.local), seed  # the initial states stay
    assert abs(found.terms[0].values[0]) < 0.5 * terms[0].values[0], seed  # nothing is hidden


def flickering(recording: Trajectory, point: int, way: float) -> Trajectory:
    """A recording in which a marker leaps to and fro by `way` [m], which no motion looks like."""
    points = recording.observations.points.copy()
    points[50:60, point] += way * (-1.0) ** np.arange(10)[:, None]
    seen = Observation(points, recording.observations.winch)
    return Trajectory(seen, recording.controls, recording.dt)


@pytest.mark.slow
def test_nothing_is_added_that_explains_next_to_nothing_of_what_is_left(robot, seed):
    gain = NAMED["winch_gain"]
    right = recorded(robot, (Term(gain, None, (0.3,)),), seed)
    wrong = flickering(recorded(robot, (), seed), seed % len(robot.points), 0.2 * robot.length)
    library = candidates(robot, {"winch_gain": gain, "slope": NAMED["slope"]})
    models = {}
    for name, recording in (("right", right), ("wrong", wrong)):
        fitter = fitter_of(Windows.cut(robot, [recording], seconds=0.4), Plant(robot))
        models[name] = Search(fitter, library).score_all(fitted(fitter))
    asked = SELECTION.least_share, SELECTION.by_chance
    assert models["right"].promises(*asked), seed
    assert models["right"].scores[0].candidate.effect is gain, seed
    assert not models["wrong"].promises(*asked), seed


def test_a_model_that_is_clearly_wrong_is_not_fitted_to_the_last_digit(robot, seed, monkeypatch):
    right = recorded(robot, (), seed)
    wrong = flickering(right, seed % len(robot.points), 0.2 * robot.length)
    asked: dict[str, list[float]] = {}
    for name, recording in (("right", right), ("wrong", wrong)):
        fitter = fitter_of(Windows.cut(robot, [recording], seconds=0.4), Plant(robot))
        begun, fit = fitter.first_estimate(), fitter.fit
        falls = asked[name] = []

        def spied(before: Fit, *args, enough: float, fit=fit, falls=falls, **options) -> Fit:
            falls.append(enough)
            return fit(before, *args, enough=enough, **options)

        monkeypatch.setattr(fitter, "fit", spied)
        Search(fitter, ()).fit_until(begun)
    assert min(asked["wrong"]) > STOPPING.converged_fall, seed
    assert asked["right"][-1] < 0.1 * min(asked["wrong"]), seed


def test_the_loudest_window_alone_begins_elsewhere(fitter: PlantFitter, seed: int) -> None:
    fit = fitted(fitter, rounds=1)
    rng = np.random.default_rng(seed)
    bent = fit.local + 3.0 * fitter.local_prior * rng.choice([-1.0, 1.0], fit.local.shape)
    astray = fitter.with_local(fit, bent)
    for most, expected in ((1, 1), (None, len(bent))):
        found = fitter.restarted(astray, Restart(seed, usual=1.0, most=most))
        moved = (found.local != bent).any(axis=1)
        assert moved.sum() == expected, seed
        assert moved[fitter.mean_squares(astray).argmax()], seed


@pytest.mark.parametrize(
    ("begins", "falls", "expected"),
    [
        (5000.0, 10.0, [[0, 1]] * 2),  # it would take too many rounds
        (500.0, 100.0, [[0, 1]] * 2 + [[1]] * 4),
        (1000.0, 100.0, [[0, 1]] * 2),
    ],
)
def test_another_start_of_a_window_goes_on_as_long_as_it_may_become_the_lowest(
    fitter: PlantFitter, monkeypatch, begins: float, falls: float, expected: list[list[int]]
) -> None:
    """One has ended at a cost of 100; the other falls by as much in each of six rounds."""
    stepped: list[list[int]] = []

    def step(_fit: Fit, members: np.ndarray, local: np.ndarray, _size: float):
        rows = local[:, 0].astype(int)
        stepped.append(rows.tolist())
        before, after = (
            np.where(rows == 0, 100.0, begins - falls * rounds)
            for rounds in (len(stepped) - 1, len(stepped))
        )
        return local, before, after

    monkeypatch.setattr(fitter, "_stepped_alone", step)
    fit = fitter.first_estimate()
    tried = np.zeros((2, fit.local.shape[1]))
    tried[1, 0] = 1.0
    fitter.searched(fit, np.zeros(2, int), tried)
    assert stepped == expected


def test_windows_that_saw_nothing_do_not_silence_those_that_did(robot: Robot, seed: int) -> None:
    recording = recorded(robot, (Term(NAMED["winch_gain"], None, (0.3,)),), seed)
    points = recording.observations.points.copy()
    points[21:] = np.nan  # of three windows nothing but where one begins
    dark = replace(recording, observations=replace(recording.observations, points=points))
    fitter = fitter_of(Windows.cut(robot, [dark], seconds=0.2), Plant(robot))
    assert len(fitter.windows) == 4
    library = candidates(robot, {"winch_gain": NAMED["winch_gain"]})
    model = Search(fitter, library).score_all(fitter.first_estimate())
    assert model.test.projection.weights[0] == 1.0, seed
    assert model.test.noise > 0.01, seed


def test_recordings_in_other_control_steps_than_the_plant_are_refused(robot, trajectory):
    with pytest.raises(DataError, match="control steps of 0.02 s, the plant in steps of 0.01 s"):
        diagnose(Plant(robot), [replace(trajectory, dt=0.02)])


@pytest.mark.parametrize("stuck", [False, True])
def test_a_further_effect_promises_more_than_a_stuck_fit_may_win_by_chance(
    fitter: PlantFitter, robot: Robot, seed: int, stuck: bool
) -> None:
    library = candidates(robot, {"winch_gain": NAMED["winch_gain"]})
    model = Search(fitter, library).score_all(fitted(fitter, rounds=2))
    statistic = float(np.random.default_rng(seed).uniform(30.0, 90.0))
    score = replace(model.scores[0], statistic=statistic)
    left = statistic * (11.0 if stuck else 9.0)
    quiet = model.test.residual * np.sqrt(0.99 / model.test.noise)
    test = replace(model.test, residual=quiet)  # nothing is left, says the linearisation
    fit = replace(model.fit, cost=test.freedom + left)
    promising = replace(model, fit=fit, test=test, scores=(score,))
    assert promising.promises(SELECTION.least_share, SELECTION.by_chance) is not stuck, seed


def test_of_models_that_are_one_by_several_names_one_is_fitted(robot, fitter, seed, monkeypatch):
    names = ("command_delay", "sensor_latency", "winch_gain")
    library = candidates(robot, {name: NAMED[name] for name in names})
    begun = fitted(fitter, rounds=1)
    late = float(np.random.default_rng(seed).uniform(0.005, 0.03))
    models = [fitter.with_terms(begun, (Term(NAMED[name], None, (late,)),)) for name in names]
    assert models[0].cost == pytest.approx(models[1].cost, rel=1e-9), seed
    fitted_on: list[str] = []

    def fit_until(_: Search, fit: Fit, *__: float | None, **___: float) -> Fit:
        fitted_on.append(fit.terms[0].effect.name)
        return fit

    monkeypatch.setattr(Search, "fit_until", fit_until)
    _fitted_in_turn(Search(fitter, library), models)
    assert "winch_gain" in fitted_on and len({*names[:2]} & {*fitted_on}) == 1, (seed, fitted_on)


def test_what_promised_the_most_and_is_not_ahead_begins_elsewhere_first(fitter, seed, monkeypatch):
    ahead, behind = fitted(fitter, rounds=2), fitter.first_estimate()
    assert ahead.cost < behind.cost, seed
    search, freed = Search(fitter, ()), replace(ahead, cost=0.5 * ahead.cost)
    begun: list[Fit] = []

    def elsewhere(fit: Fit, _: Restart) -> Fit:
        begun.append(fit)
        return freed if fit is behind else fit

    monkeypatch.setattr(fitter, "restarted", elsewhere)
    monkeypatch.setattr(Search, "fit_until", lambda _, fit, *__, **___: fit)
    monkeypatch.setattr(f"{STEPWISE}.shorter_steps", lambda fitter, fit, _: (fitter, fit))
    assert _fitted_in_turn(search, [behind, ahead])[1][0] is freed
    assert begun[0] is behind
    begun.clear()
    assert _fitted_in_turn(search, [ahead, behind])[1][0] is ahead
    assert not any(fit is behind for fit in begun)


def test_what_promised_the_most_and_is_not_ahead_is_fitted_in_the_steps_that_it_needs(
    fitter, seed, monkeypatch
):
    ahead, behind = fitted(fitter, rounds=2), fitter.first_estimate()
    assert ahead.cost < behind.cost, seed
    finer, fits_there = copy(fitter), replace(ahead, cost=0.5 * ahead.cost)

    def shorter(own, fit, _):
        return (finer, fits_there) if fit is behind else (own, fit)

    monkeypatch.setattr(fitter, "restarted", lambda fit, _: fit)
    monkeypatch.setattr(Search, "fit_until", lambda _, fit, *__, **___: fit)
    monkeypatch.setattr(f"{STEPWISE}.shorter_steps", shorter)
    search, (best, _) = _fitted_in_turn(Search(fitter, ()), [behind, ahead])
    assert best is fits_there and search.fitter is finer


@pytest.mark.slow
def test_windows_of_a_model_that_is_wrong_otherwise_do_not_all_begin_elsewhere(
    robot: Robot, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = recorded(robot, (), seed)
    wrong = flickering(right, seed % len(robot.points), 0.2 * robot.length)
    for recording, states_are_wrong in ((right, True), (wrong, False)):
        fitter = fitter_of(Windows.cut(robot, [recording], seconds=0.4), Plant(robot))
        fit, asked, restarted = fitted(fitter), [], fitter.restarted
        if states_are_wrong:
            fit = fitter.with_local(fit, fit.local + 3.0 * fitter.local_prior)

        def elsewhere(fit: Fit, restart: Restart, asked=asked, restarted=restarted) -> Fit:
            asked.append(restart.most)
            return restarted(fit, restart)

        monkeypatch.setattr(fitter, "restarted", elsewhere)
        found = restarted_with_care(fitter, fit, Restart(seed, usual=1.0))
        assert asked == ([1, None] if states_are_wrong else [1]), seed
        assert (found is not fit) == states_are_wrong, seed


def test_a_model_that_is_clearly_wrong_begins_elsewhere_in_its_loudest_window_first(
    fitter: PlantFitter, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, asked = fitter.first_estimate(), []

    def elsewhere(fit: Fit, restart: Restart) -> Fit:
        asked.append(restart.most)
        return fit

    monkeypatch.setattr(fitter, "restarted", elsewhere)
    monkeypatch.setattr(Search, "fit_until", lambda *_: pytest.fail("nothing has changed"))
    for times_noise in (2.0, 1.0):
        fit = replace(begun, cost=times_noise * fitter.freedom)
        assert Search(fitter, ()).unstuck(fit) is fit
    assert asked == [1, None]


def test_a_model_as_given_that_is_clearly_wrong_is_not_fitted_to_the_last_digit(
    fitter: PlantFitter, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, asked, worth = fitter.first_estimate(), [], []

    def elsewhere(fit: Fit, restart: Restart) -> Fit:
        asked.append(restart.most)
        return fit

    def fit(begun: Fit, *_: object, enough: float = 0.0, **__: object) -> Fit:
        worth.append(enough)
        return begun

    monkeypatch.setattr(fitter, "restarted", elsewhere)
    monkeypatch.setattr(fitter, "fit", fit)
    monkeypatch.setattr(fitter, "finer", lambda *_: None)
    for times_noise in (2.0, 1.0):
        worth.clear()
        cost = times_noise * fitter.freedom
        assert fitted_as_given(fitter, replace(begun, cost=cost))[1].cost == cost
        before, *after = (each > 0.0 for each in worth)
        assert not before and set(after) == {times_noise > 1.0}
    assert asked == [1, None]


def test_a_model_that_diverges_is_given_up_after_a_round(fitter, monkeypatch):
    diverged = replace(fitter.first_estimate(), cost=np.inf)
    rounds: list[Fit] = []

    def fit(begun: Fit, *_: object, **__: object) -> Fit:
        rounds.append(begun)
        return begun

    monkeypatch.setattr(fitter, "fit", fit)
    assert Search(fitter, ()).fit_until(diverged) is diverged and len(rounds) == 1


def test_other_values_of_what_a_plant_had_are_an_answer_and_better_initial_states_are_none(
    robot: Robot, fitter: PlantFitter, monkeypatch: pytest.MonkeyPatch
) -> None:
    (candidate,) = candidates(robot, {"winch_gain": NAMED["winch_gain"]})
    search = Search(fitter, (candidate,))
    plain = search.score_all(fitted(fitter, rounds=1))
    had, half = (candidate.term((0.1,)),), 0.5 * plain.fit.cost
    for terms, fall, expected in ((had, half, 2), (had, 0.1, 1), ((), half, 1)):
        first = replace(plain, fit=replace(plain.fit, terms=terms))
        better = iter([replace(first.fit, cost=first.fit.cost - fall), None])

        def found(search, *_, better=better):
            return search, next(better)

        monkeypatch.setattr(f"{STEPWISE}._with_other_values", lambda *_: None)
        monkeypatch.setattr(f"{STEPWISE}._next", found)
        monkeypatch.setattr(Search, "score_all", lambda _, fit, at=first: replace(at, fit=fit))
        assert len(_forward(search, first)[1]) == expected
