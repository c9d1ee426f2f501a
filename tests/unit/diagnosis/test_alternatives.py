"""What effects of an answer are exchanged for others on."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flywheel.diagnosis import Verdict
from flywheel.diagnosis.fitting.baseline import fitted
from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.plant_fit import StartFitter
from flywheel.diagnosis.selection import alternatives as exchange
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.stepwise import Selection
from flywheel.effects import EFFECTS, Term
from flywheel.robots import Robot

# By its path: the package has a function of that name.
concluding: Any = import_module("flywheel.diagnosis.diagnose")


def test_an_effect_is_exchanged_on_the_latest_step_without_it_or_on_a_fit_anew() -> None:
    had, moved = (Term(EFFECTS["winch_gain"], None, (share,)) for share in (0.1, 0.2))
    found = Term(EFFECTS["cable_damping"], None, (500.0,))
    steps: Any = [
        SimpleNamespace(fit=SimpleNamespace(terms=terms))
        for terms in ((had,), (moved,), (moved, found))
    ]
    selection: Any = SimpleNamespace(
        look=lambda fit: ("looked at", fit), dropped=lambda fit, term: term
    )
    assert exchange._without(selection, steps, found) is steps[1]
    assert exchange._without(selection, steps, moved) == ("looked at", moved)


def test_of_rivals_that_are_one_by_several_names_one_is_fitted(
    robot: Robot, fitter: StartFitter, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("command_delay", "sensor_latency")
    library = candidates(robot, {name: EFFECTS[name] for name in (*names, "winch_gain")})
    selection = Selection(fitter, library, 25.0)
    found = Term(EFFECTS["winch_gain"], None, (0.05,))
    last = fitter.under(fitted(fitter, rounds=1), (found,))
    late = float(np.random.default_rng(seed).uniform(0.005, 0.03))
    scores: Any = [
        SimpleNamespace(candidate=each, sizes=(late / each.typical[0],), shape=0)
        for each in library
        if each.effect.name in names
    ]
    pursued: list[str] = []

    def pursue(fit: Fit, *_: float) -> Fit:
        pursued.append(fit.terms[-1].effect.name)
        return fit

    monkeypatch.setattr(selection, "pursued", pursue)
    as_good = exchange._in_place(selection, last, found, scores, margin=np.inf)
    assert pursued == [scores[0].candidate.effect.name], seed
    assert {fit.terms[-1].effect.name for fit in as_good} == {*names}, seed
    assert as_good[0].cost == pytest.approx(as_good[1].cost, rel=1e-6), seed


def test_values_that_another_effect_cannot_have_make_no_twin(
    robot: Robot, fitter: StartFitter, seed: int
) -> None:
    """A gain may be negative, a delay not."""
    (late,) = candidates(robot, {"command_delay": EFFECTS["command_delay"]})
    selection = Selection(fitter, (late,), 25.0)
    gain = Term(EFFECTS["winch_gain"], None, (-0.05,))
    last = fitter.under(fitter.beginning(), (gain,))
    score: Any = SimpleNamespace(candidate=late, sizes=(0.01,), shape=0)
    assert exchange._twin(selection, last, gain, score) is None, seed


@pytest.mark.parametrize(("costs", "left"), [((130.0, 124.0), 1), ((130.0, 126.0), None)])
def test_an_effect_goes_that_turns_out_not_to_be_needed(
    fitter: StartFitter, costs: tuple[float, float], left: int | None
) -> None:
    """With the better starts that were found meanwhile; each has to explain 25 here."""
    selection = Selection(fitter, (), 25.0)
    terms = tuple(Term(EFFECTS[n], None, (0.1,)) for n in ("winch_gain", "cable_friction"))
    last = replace(fitter.beginning(), cost=100.0)
    steps: list[Any] = [SimpleNamespace(fit=replace(last, cost=cost)) for cost in costs]
    found = exchange.Exchange(last, (), tuple(zip(terms, steps, strict=True)))
    assert found.shorter(selection) is (None if left is None else steps[left])
    alone = exchange.Exchange(last, (), ((terms[1], steps[1]),))
    assert alone.shorter(selection) is None  # without the only one nothing is left


def test_an_answer_is_judged_without_what_is_not_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = (Term(EFFECTS[name], None, (0.1,)) for name in ("winch_gain", "cable_friction"))
    first, shorter, other, last = (
        SimpleNamespace(fit=SimpleNamespace(terms=terms)) for terms in ((), (b,), (a,), (a, b))
    )
    exchanges = iter([SimpleNamespace(shorter=lambda _: shorter)])
    judged: list[Any] = []

    def judge(_: Any, steps: list[Any]) -> Any:
        judged.append(steps)
        return SimpleNamespace(steps=steps, verdict=Verdict.NOISE_ONLY)

    monkeypatch.setattr(concluding, "exchanged", lambda *_: next(exchanges))
    monkeypatch.setattr(concluding, "_judged", judge)
    search: Any = SimpleNamespace(
        selection=SimpleNamespace(criterion=None, new=lambda _: ()),
        limits=SimpleNamespace(equally_good=1.0),
    )
    begun: Any = SimpleNamespace(steps=[first, other, last], verdict=Verdict.EFFECT)
    settled, others = concluding._settled(search, begun)
    assert judged == [[first, shorter]]
    assert (settled.steps, others) == ([first, shorter], [])


def test_a_shortened_answer_loses_what_is_not_shown_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the whole one would, whose intervals are others."""
    names = ("winch_gain", "cable_friction", "cable_damping")
    a, b, c = (Term(EFFECTS[name], None, (0.1,)) for name in names)

    def step(*terms: Term) -> Any:
        return SimpleNamespace(fit=SimpleNamespace(terms=terms))

    def judge(_: Any, steps: list[Any]) -> Any:
        terms = steps[-1].fit.terms
        answer = [SimpleNamespace(term=t, shown=t is not b, certainty=0.1) for t in terms]
        return SimpleNamespace(steps=steps, answer=answer, verdict=Verdict.NOISE_ONLY)

    exchange_of = SimpleNamespace(shorter=lambda _: step(a, b))
    monkeypatch.setattr(concluding, "exchanged", lambda *_: exchange_of)
    monkeypatch.setattr(concluding, "_judged", judge)
    selection = SimpleNamespace(
        new=lambda steps: steps[-1].fit.terms,
        shortened=lambda fit, term: step(*(t for t in fit.terms if t is not term)).fit,
        look=lambda fit: step(*fit.terms),
    )
    search: Any = SimpleNamespace(selection=selection, limits=SimpleNamespace(equally_good=1.0))
    begun: Any = SimpleNamespace(steps=[step(), step(a), step(a, b, c)], verdict=Verdict.EFFECT)
    settled, _ = concluding._settled(search, begun)
    assert [each.fit.terms for each in settled.steps] == [(), (a,)]
