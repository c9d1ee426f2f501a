"""What is seen from first estimates, where fitted starts were led astray."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flywheel.diagnosis.fitting.baseline import fitted, fitter_of
from flywheel.diagnosis.fitting.plant_fit import StartFitter
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import Candidate, candidates
from flywheel.diagnosis.selection.screening import at_first_sight
from flywheel.diagnosis.selection.step import Step
from flywheel.diagnosis.selection.stepwise import Selection
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Term
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded

NAMES = ("winch_gain", "payload", "hysteresis")
Misled = tuple[StartFitter, Step]


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
    step = Selection(fitter, library, 25.0).look(fitted(fitter, rounds=2))
    return fitter, replace(step, scores=tuple(replace(s, power=1.0) for s in step.scores))


def test_a_large_effect_is_seen_with_its_sign(
    misled: Misled, library: tuple[Candidate, ...], seed: int, sign: float
) -> None:
    ((term,),) = at_first_sight(*misled, library, known=())
    assert term.effect.name == "winch_gain", seed
    assert np.sign(term.values[0]) == sign, seed


def test_what_a_score_proposes_is_not_proposed_again_but_with_the_other_sign(
    robot: Robot, misled: Misled, library: tuple[Candidate, ...], seed: int, sign: float
) -> None:
    score = next(s for s in misled[1].scores if s.candidate.effect.name == "winch_gain")
    same, other = (replace(score, sizes=(way * sign,)) for way in (0.5, -0.5))
    assert at_first_sight(*misled, library, known=(same,)) == [], seed
    assert len(at_first_sight(*misled, library, known=(other,))) == 1, seed
    (slope,) = candidates(robot, {"slope": EFFECTS["slope"]})
    aslant = replace(score, candidate=slope, sizes=(1.0, 1.0))  # two sizes beside one
    assert len(at_first_sight(*misled, library, known=(aslant,))) == 1, seed


def test_nothing_is_looked_for_where_a_score_promises_much(
    misled: Misled, library: tuple[Candidate, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    fitter, step = misled
    first, *others = step.scores
    monkeypatch.setattr(StartFitter, "beginning", None)  # nothing is simulated either
    sure = replace(step, scores=(replace(first, power=0.6 * step.left), *others))
    assert at_first_sight(fitter, sure, library, known=()) == []


def test_nothing_is_looked_for_where_the_model_may_be_right(
    misled: Misled, library: tuple[Candidate, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    fitter, step = misled
    monkeypatch.setattr(StartFitter, "beginning", None)
    right = replace(step, fit=replace(step.fit, cost=1.05 * fitter.freedom(step.fit)))
    assert right.left > 10.0  # of which the scores promise one
    assert at_first_sight(fitter, right, library, known=()) == []


def test_what_explains_little_is_not_proposed(
    misled: Misled, library: tuple[Candidate, ...], seed: int
) -> None:
    payloads = [each for each in library if each.effect.name == "payload"]  # a tenth at most
    assert at_first_sight(*misled, payloads, known=()) == [], seed


def test_what_is_seen_at_first_is_fitted_beside_what_scores_propose(
    misled: Misled,
    library: tuple[Candidate, ...],
    seed: int,
    sign: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fitter, step = misled
    selection = Selection(fitter, library, 25.0)
    wrong = next(s for s in step.scores if s.candidate.effect.name == "payload")
    monkeypatch.setattr("flywheel.diagnosis.selection.stepwise.promising_pairs", lambda *_: [])
    monkeypatch.setattr(selection, "short", lambda _: [replace(wrong, sizes=(1.0,))])
    scores = tuple(replace(s, power=1.0, score=30.0) for s in step.scores)
    then = tuple(replace(s, power=0.0) for s in step.scores)
    monkeypatch.setattr(selection, "look", lambda fit: replace(step, fit=fit, scores=then))
    found = selection.run(replace(step, scores=scores))[-1]
    assert [term.effect.name for term in found.fit.terms] == ["winch_gain"], seed
    assert found.fit.terms[0].values[0] == pytest.approx(0.3 * sign, abs=0.05), seed


def test_what_a_model_has_is_not_tried_again(
    misled: Misled, library: tuple[Candidate, ...], seed: int, sign: float
) -> None:
    fitter, step = misled
    right = next(each for each in library if each.effect.name == "winch_gain")
    had = Term(EFFECTS["winch_gain"], None, (0.01 * sign,))
    wrong = replace(step, fit=replace(step.fit, terms=(had,)))
    assert at_first_sight(fitter, step, [right], known=()), seed
    assert at_first_sight(fitter, wrong, [right], known=()) == [], seed
