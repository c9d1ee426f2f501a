"""A robot whose numbers are all a little off is told from one that lacks an effect."""

from __future__ import annotations

import json

import numpy as np
import pytest

from flywheel.diagnosis import Diagnosis, Verdict, diagnose
from flywheel.diagnosis.adoption import adoptable
from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.model import ModelUnderTest
from flywheel.diagnosis.fitting.nuisance import as_built_terms, asked
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.forms import in_other_forms
from flywheel.diagnosis.selection.score_test import ScoredModel
from flywheel.diagnosis.selection.search import Search
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS
from flywheel.errors import DataError
from flywheel.records import Trajectory
from flywheel.reports.diagnosis_page import as_built, diagnosis_page, sentence
from flywheel.robots import Robot, load_robot
from flywheel.truth_simulator import AsBuilt, hidden_effect
from flywheel.truth_simulator.effect import HiddenEffect
from flywheel.truth_simulator.recording import record

pytestmark = pytest.mark.slow
FEW = {name: EFFECTS[name] for name in ("winch_gain", "cable_damping", "weak_cable")}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("platform4")


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


def test_its_numbers_are_on_the_page_and_in_json_and_not_adopted(built: Diagnosis) -> None:
    numbers = built.as_built
    assert numbers is not None
    said = json.loads(json.dumps(built.summary()))["as_built"]
    off = [each["deviations"] for each in said["numbers"]]
    assert off == sorted(off, reverse=True)
    assert sum(len(each["parameters"]) for each in said["numbers"]) == numbers.count
    assert sentence(built).startswith("No effect is missing: numbers of the MJCF")
    assert numbers.farthest[0].label in as_built(built)
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
    search = Search(fitter, library, threshold=25.0, as_built=as_built_terms(robot))
    fit = fitter.keeping(fitter.with_terms(first, search.as_built), search.as_built)
    return search, search.score_all(fit)


def test_sensitivities_that_are_kept_become_those_of_where_the_fit_is(
    begun: tuple[Search, ScoredModel],
) -> None:
    search, model = begun

    def off(fit: Fit) -> float:
        kept, anew = fit.kept, search.fitter.kept_anew(fit).kept
        assert kept is not None and anew is not None
        return float(np.linalg.norm(kept.columns - anew.columns) / np.linalg.norm(anew.columns))

    fit = search.fit_until(model.fit)
    settled = search.settled(fit)
    assert off(settled) < 0.3 * off(fit)
    assert settled.cost <= fit.cost


def test_an_effect_in_the_place_of_another_is_exchanged(begun: tuple[Search, ScoredModel]) -> None:
    search, model = begun
    friction = next(s for s in model.scores if s.candidate.label == "cable_friction")
    term = friction.candidate.term(friction.sizes, friction.shape)
    fit = search.fitter.with_terms(model.fit, (*model.fit.terms, term))
    wrong = search.score_all(search.settled(search.fit_until(fit)))
    right = in_other_forms(search, model, wrong, model.scores).fit
    (found,) = asked(right.terms)
    assert found.effect.name == "capstan"
    assert search.criterion(right) < search.criterion(wrong.fit) - search.threshold
