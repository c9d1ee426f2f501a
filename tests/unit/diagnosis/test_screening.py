"""What is seen from first estimates, where fitted initial states were led astray."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import Candidate, candidates
from flywheel.diagnosis.selection.proposals import screened
from flywheel.diagnosis.selection.scores import ScoredModel
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.selection.stepwise import stepwise
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Term
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded

pytestmark = pytest.mark.slow

NAMES = ("winch_gain", "payload", "hysteresis")
Misled = tuple[Search, ScoredModel]


@pytest.fixture(scope="module")
def sign(seed: int) -> float:
    return float(np.random.default_rng(seed).choice([-1.0, 1.0]))


@pytest.fixture(scope="module")
def library(robot: Robot) -> tuple[Candidate, ...]:
    return candidates(robot, {name: EFFECTS[name] for name in NAMES})


@pytest.fixture(scope="module")
def misled(robot: Robot, library: tuple[Candidate, ...], seed: int, sign: float) -> Misled:
    """A model without a large gain of the winches, whose scores promise next to nothing."""
    hidden = (Term(EFFECTS["winch_gain"], None, (0.3 * sign,)),)
    windows = Windows.cut(robot, [recorded(robot, hidden, seed)], seconds=0.4)
    fitter = fitter_of(windows, Plant(robot))
    search = Search(fitter, library)
    model = search.score_all(fitted(fitter, rounds=2))
    return search, replace(model, scores=tuple(replace(s, statistic=1.0) for s in model.scores))


def test_a_large_effect_is_seen_with_its_sign(misled, seed, sign):
    ((term,),) = screened(*misled, known=())
    assert term.effect.name == "winch_gain", seed
    assert np.sign(term.values[0]) == sign, seed


def test_what_a_score_proposes_is_not_proposed_again_but_with_the_other_sign(
    robot: Robot, misled: Misled, seed: int, sign: float
) -> None:
    score = next(s for s in misled[1].scores if s.candidate.effect.name == "winch_gain")
    same, other = (replace(score, sizes=(way * sign,)) for way in (0.5, -0.5))
    assert screened(*misled, known=(same,)) == [], seed
    assert len(screened(*misled, known=(other,))) == 1, seed
    (slope,) = candidates(robot, {"slope": EFFECTS["slope"]})
    aslant = replace(score, candidate=slope, sizes=(1.0, 1.0))  # two sizes beside one
    assert len(screened(*misled, known=(aslant,))) == 1, seed


def test_nothing_is_looked_for_where_a_score_promises_much(misled, monkeypatch):
    search, model = misled
    first, *others = model.scores
    monkeypatch.setattr(PlantFitter, "first_estimate", None)  # nothing is simulated either
    sure = replace(model, scores=(replace(first, statistic=0.6 * model.left), *others))
    assert screened(search, sure, known=()) == []


def test_nothing_is_looked_for_where_the_model_may_be_right(misled, monkeypatch):
    search, model = misled
    monkeypatch.setattr(PlantFitter, "first_estimate", None)
    right = replace(model, fit=replace(model.fit, cost=1.05 * search.fitter.freedom))
    assert right.left > 10.0  # of which the scores promise one
    assert screened(search, right, known=()) == []


def test_what_explains_little_is_not_proposed(misled, seed):
    search, model = misled
    payloads = tuple(c for c in search.library if c.effect.name == "payload")  # a tenth at most
    assert screened(replace(search, library=payloads), model, known=()) == [], seed


def test_what_is_screened_is_fitted_beside_what_scores_propose(
    misled: Misled,
    seed: int,
    sign: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search, model = misled
    wrong = next(s for s in model.scores if s.candidate.effect.name == "payload")
    scores = tuple(replace(s, statistic=1.0, score=30.0) for s in model.scores)
    then = tuple(replace(s, statistic=0.0) for s in model.scores)
    monkeypatch.setattr("flywheel.diagnosis.selection.proposals.promising_pairs", lambda *_: [])
    monkeypatch.setattr(Search, "shortlist", lambda *_: [replace(wrong, sizes=(1.0,))])
    monkeypatch.setattr(Search, "score_all", lambda _, fit: replace(model, fit=fit, scores=then))
    found = stepwise(search, replace(model, scores=scores))[1][-1]
    assert [term.effect.name for term in found.fit.terms] == ["winch_gain"], seed
    assert found.fit.terms[0].values[0] == pytest.approx(0.3 * sign, abs=0.05), seed


def test_what_a_model_has_is_not_tried_again(misled, seed, sign):
    search, model = misled
    right = tuple(each for each in search.library if each.effect.name == "winch_gain")
    search = replace(search, library=right)
    had = Term(EFFECTS["winch_gain"], None, (0.01 * sign,))
    wrong = replace(model, fit=replace(model.fit, terms=(had,)))
    assert screened(search, model, known=()), seed
    assert screened(search, wrong, known=()) == [], seed
