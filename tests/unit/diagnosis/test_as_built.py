"""A robot whose numbers are all a little off is told from one that lacks an effect."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from flywheel.diagnosis import Diagnosis, Verdict, diagnose
from flywheel.diagnosis.adoption import adoptable
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.model import ModelUnderTest, fitted
from flywheel.diagnosis.fitting.nuisance import as_built_terms, asked
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.scores import ScoredModel
from flywheel.diagnosis.selection.search import SHAKE, Search
from flywheel.diagnosis.selection.stepwise import USUALLY_OFF, _as_built, _numbers_are_needed
from flywheel.diagnosis.settings import AsBuiltSettings, FittingSettings
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Term, Terms, taken_apart
from flywheel.errors import DataError
from flywheel.records import Trajectory
from flywheel.reports.diagnosis_page import as_built, diagnosis_page, sentence
from flywheel.robots import Robot
from flywheel.truth_simulator import AsBuilt, hidden_effect
from flywheel.truth_simulator.effect import HiddenEffect
from flywheel.truth_simulator.recording import record

ROBOT = "platform4"

pytestmark = pytest.mark.slow
FEW = {name: EFFECTS[name] for name in ("winch_gain", "cable_damping", "weak_cable")}


def logs_of(robot: Robot, hidden: tuple[HiddenEffect, ...]) -> list[Trajectory]:
    made = [record(robot, hidden, seconds=1.2, seed=seed) for seed in (1, 2)]
    return [each.trajectory for each in made]


@pytest.fixture(scope="module")
def built(robot: Robot) -> Diagnosis:
    """Of a robot that lacks nothing, and is right nowhere."""
    logs = logs_of(robot, (AsBuilt.typical(robot, np.random.default_rng(5)),))
    return diagnose(Plant(robot), logs[:1], logs[1:], FEW)


def test_no_effect_is_named_where_only_numbers_are_off(built: Diagnosis) -> None:
    assert built.verdict is Verdict.NOISE_ONLY
    assert built.before.noise > 1.2 > 1.06 > built.after.noise
    assert built.held_out is not None
    assert built.held_out.augmented < built.held_out.baseline
    assert built.as_built is not None
    assert not built.calibration
    assert 0.2 < built.as_built.root_mean_square < 1.5


def test_no_effect_is_named_where_numbers_are_off_by_less_than_is_usual(robot: Robot) -> None:
    """Numbers that may be as far off as usual would cost more than one cable that is a little weak."""
    numbers = AsBuilt.typical(robot, np.random.default_rng(7)).scaled(0.4)
    logs = logs_of(robot, (numbers,))
    found = diagnose(Plant(robot), logs[:1], logs[1:], FEW)
    assert found.verdict is Verdict.NOISE_ONLY
    assert found.as_built is not None
    assert found.as_built.share == 0.25
    assert found.as_built.root_mean_square < 0.25
    assert "most likely with 0.25 of that standard deviation" in as_built(found)
    assert json.loads(json.dumps(found.summary()))["as_built"]["share"] == 0.25


def test_its_numbers_are_on_the_page_and_in_json_and_not_adopted(built: Diagnosis) -> None:
    numbers = built.as_built
    assert numbers is not None
    said = json.loads(json.dumps(built.summary()))["as_built"]
    off = [each["deviations"] for each in said["numbers"]]
    assert off == sorted(off, reverse=True)
    assert sum(len(each["parameters"]) for each in said["numbers"]) == numbers.count
    assert sentence(built).startswith("No effect is missing: numbers of the MJCF")
    assert numbers.farthest[0].label in as_built(built)
    assert [rung.label for rung in built.evidence.ladder] == ["initial model", "+ numbers as built"]
    assert numbers.farthest[-1].location in diagnosis_page(built, {})
    with pytest.raises(DataError, match="there is no effect to adopt"):
        adoptable(built.summary())


def test_a_robot_that_is_right_otherwise_is_answered_without_them(robot: Robot) -> None:
    """One weak cable is a number that is off, too: far more than numbers usually are."""
    weak = hidden_effect("weak_cable").typical(robot, np.random.default_rng(0)).scaled(1.5)
    logs = logs_of(robot, (weak,))
    found = diagnose(Plant(robot), logs[:1], logs[1:], FEW)
    assert found.verdict is Verdict.EFFECT
    assert found.as_built is None
    ((effect,),) = found.answers
    assert effect.effect == "weak_cable"


@pytest.fixture(scope="module")
def begun(robot: Robot) -> tuple[Search, ScoredModel]:
    """A search where numbers are off and capstan friction is missing; with the numbers, not fitted yet."""
    hidden = hidden_effect("capstan").typical(robot, np.random.default_rng(0)).scaled(8.0)
    numbers = AsBuilt.typical(robot, np.random.default_rng(5)).scaled(2.0)
    (log,) = logs_of(robot, (numbers, hidden))[:1]
    fitter, first = ModelUnderTest(Plant(robot), None, 0).fitted([log])
    library = candidates(robot, {name: EFFECTS[name] for name in ("cable_friction", "capstan")})
    search = Search(fitter, library, as_built=as_built_terms(robot))
    fit = fitter.keeping(fitter.with_terms(first, search.as_built), search.as_built)
    return search, search.score_all(fit)


def test_sensitivities_that_are_kept_become_those_of_where_the_fit_is(begun):
    search, model = begun

    def off(fit: Fit) -> float:
        kept, anew = fit.kept, search.fitter.kept_anew(fit).kept
        assert kept is not None and anew is not None
        return float(np.linalg.norm(kept.columns - anew.columns) / np.linalg.norm(anew.columns))

    fit = search.fit_until(model.fit)
    settled = search.settled(fit)
    assert off(settled) < 0.3 * off(fit)
    assert settled.cost <= fit.cost


def test_numbers_that_recordings_hardly_show_keep_their_sensitivities(begun, monkeypatch):
    search, model = begun
    fitter, fit = search.fitter, search.fit_until(model.fit)
    anew = []
    for least in (0.0, 1.0, np.inf):
        monkeypatch.setattr("flywheel.diagnosis.fitting.least_squares.LEAST_SHOWN", least)
        changed = fitter.kept_anew(fit).kept.columns != fit.kept.columns
        anew.append(changed.any(axis=(0, 1)).sum())
    assert anew[0] > anew[1] > anew[2] == 0


def test_fits_are_shaken_by_the_seed_of_the_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two seeds move the numbers elsewhere, and one twice to the same places."""
    fit = SimpleNamespace(kept=(), terms=(), cost=1.0, local=np.zeros(1), outdated=lambda _: fit)
    fitter = SimpleNamespace(
        settings=FittingSettings(),
        windows=SimpleNamespace(noisy=np.ones(2)),
        kept_anew=lambda fit: fit,
        fit=lambda fit, free, **_: fit,
        free=lambda terms: [],
        with_terms=lambda fit, terms: fit,
    )
    found: list[list[float]] = []

    def shaken(terms: Terms, size: float, rng: np.random.Generator) -> Terms:
        found[-1].append(rng.normal())
        return terms

    monkeypatch.setattr("flywheel.diagnosis.selection.search.shaken_terms", shaken)
    for seed in (0, 0, 1):
        found.append([])
        Search(cast(Fitter, fitter), (), seed=seed).settled(cast(Fit, fit))
    assert found[0] == found[1] and not set(found[0]) & set(found[2])


@pytest.mark.parametrize("outside", [False, True])
def test_numbers_explain_no_robot_that_one_law_explains_as_well(begun, outside):
    search, _ = begun
    model = search.score_all(fitted(search.fitter, rounds=1))
    idle = replace(model.scores[0], statistic=0.0, score=0.0)
    model = replace(model, scores=(idle,), probes=(idle,))
    promise = search.promised_as_built(model, 25.0)
    assert promise is not None
    assert _as_built(search, model) is not None
    law = (replace(idle, statistic=0.9 * promise.explained),)
    seen = replace(model, probes=law) if outside else replace(model, scores=law)
    assert _as_built(search, seen) is None


@pytest.mark.parametrize(("unlikely", "needed"), [(1e-3, False), (0.5, True)])
def test_numbers_are_doubted_that_explain_less_than_noise_seldom_does(
    begun, unlikely, needed, monkeypatch
):
    """As much as the median of chi-square with so many degrees of freedom, and a little more."""
    search, model = begun
    more = 1.05 * sum(len(term.values) for term in search.as_built)
    monkeypatch.setattr("flywheel.diagnosis.selection.stepwise.RARE", unlikely)
    assert alone_beside((search, model), 0.01, (), more) == needed


def test_a_fit_that_is_stuck_goes_on_from_beside_itself(begun, monkeypatch):
    """Nothing helps where it is; beside it, with numbers moved a little and within their bounds, it does."""
    search, model = begun
    weak = Term(EFFECTS["weak_cable"], 1, (0.6,))
    stuck = search.fitter.with_terms(model.fit, (*model.fit.terms, weak))

    def after_rounds(_: Search, fit: Fit, **__: int) -> Fit:
        return fit if fit.terms == stuck.terms else replace(fit, cost=stuck.cost - 9.0)

    monkeypatch.setattr(Search, "_after_rounds_anew", after_rounds)
    found = search.settled(stuck)
    assert found.cost == stuck.cost - 9.0
    assert asked(found.terms) == (weak,)
    moved = [v / k for t in found.terms if t.known for v, k in zip(t.values, t.known, strict=True)]
    assert np.std(moved) == pytest.approx(SHAKE, rel=0.4)
    number = next(
        t for t in taken_apart(found.terms) if t.effect.name == "weak_cable" and t.place == 1
    )
    assert number.values == (0.0,)  # held


def with_effect(search: Search, model: ScoredModel, name: str) -> Fit:
    """A model and an effect as large as its score says, before anything is fitted."""
    score = next(s for s in model.scores if s.candidate.label == name)
    term = score.term
    return search.fitter.with_terms(model.fit, (*model.fit.terms, term))


def test_an_effect_is_fitted_before_numbers_may_make_up_for_it(begun):
    search, model = begun
    fit = with_effect(search, model, "capstan")
    found = search.effects_first(fit)
    (before,), (after,) = asked(fit.terms), asked(found.terms)
    assert after.values != before.values
    assert not any(v for t in found.terms if t is not after for v in t.values)
    assert found.cost < fit.cost
    assert not found.converged  # the numbers are yet to come
    assert found.kept is not None


def test_what_an_effect_said_is_said_by_its_number_within_what_is_believed(begun):
    search, model = begun
    weak = Term(EFFECTS["weak_cable"], 1, (0.6,))
    fit = search.fitter.with_terms(model.fit, (*model.fit.terms, weak))
    free = [f for f in search.fitter.free(fit.terms) if not any(f.room(fit.terms))]
    assert len(free) == 1  # its number says nothing beside it
    less = search.begun_without(fit, weak)
    assert not asked(less.terms)
    number = next(
        t for t in taken_apart(less.terms) if t.effect.name == "weak_cable" and t.place == 1
    )
    assert number.values[0] == pytest.approx(search.fitter.settings.believed * 0.08)


def alone_beside(
    begun: tuple[Search, ScoredModel], share: float, others: tuple[Term, ...], more: float
) -> bool:
    """Whether numbers are needed beside a weak cable alone, with others, where they explain `more`."""
    search, model = begun
    first = replace(model, fit=search.fitter.first_estimate())
    terms = (Term(EFFECTS["weak_cable"], 1, (share,)), *others)
    fit = replace(search.fitter.with_terms(first.fit, terms), cost=model.fit.cost + more)
    return _numbers_are_needed(search, [first, replace(first, fit=fit)], model)


def test_beside_another_effect_one_that_is_a_number_within_what_is_usual_is_none(begun):
    friction = Term(EFFECTS["capstan"], None, (0.1,))
    usual = USUALLY_OFF * AsBuiltSettings().stiffness
    assert alone_beside(begun, 0.9 * usual, (friction,), 0.0)
    assert not alone_beside(begun, 1.1 * usual, (friction,), 0.0)
    assert not alone_beside(begun, 0.9 * usual, (), 0.0)


@pytest.mark.parametrize(
    ("missing", "fall", "rounds"),
    [(9.0, 0.0, 1 + 3), (501.0, 0.0, 1), (2100.0, 200.0, 2), (2500.0, 200.0, 1)],
)
def test_a_fit_that_clearly_stays_above_its_target_is_left_where_it_is(
    begun: tuple[Search, ScoredModel], monkeypatch, missing: float, fall: float, rounds: int
) -> None:
    """One that ended near it begins beside itself; one that falls too slowly has no further round."""
    search, model = begun
    falls = iter([fall])

    def after_rounds(_: Search, fit: Fit, **__: int) -> Fit:
        done.append(fit)
        return replace(fit, cost=fit.cost - next(falls, 0.0))

    done: list[Fit] = []
    monkeypatch.setattr(Search, "_after_rounds_anew", after_rounds)
    search.settled(model.fit, search.criterion(model.fit) - missing)
    assert len(done) == rounds


def test_effects_alone_leave_no_more_than_numbers_explain_of_noise(begun):
    numbers = sum(len(term.values) for term in begun[0].as_built)
    assert not alone_beside(begun, 0.6, (), numbers)
    assert alone_beside(begun, 0.6, (), 2.0 * numbers)
