"""Other models that explain the data as well, and answers that turn out shorter."""

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flywheel.diagnosis import Limits, Verdict
from flywheel.diagnosis.checks.adequacy import Adequacy
from flywheel.diagnosis.checks.held_out_gain import Gain
from flywheel.diagnosis.fitting.least_squares import Fit, KeptColumns
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.results.verdict import Facts
from flywheel.diagnosis.selection import alternatives
from flywheel.diagnosis.selection.alternatives import ExchangedModels
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.scores import Score
from flywheel.diagnosis.selection.search import Search
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Term
from flywheel.robots import Robot, load_robot
from tests.unit.diagnosis.conftest import recorded

# By its path: the package has a function of that name.
conclusion: Any = import_module("flywheel.diagnosis.judgement")


def facts_of(verdict: Verdict, answer: tuple[Any, ...] = ()) -> Facts:
    """Facts with this verdict, about an answer that is shown."""
    quiet = Adequacy(1.0, 0.0, loudest=0.0, correlation=0.0, inconstancy=0.0, beyond_noise=0.0)
    loud = replace(quiet, noise=10.0)
    after = {Verdict.EFFECT: quiet, Verdict.PARTIAL: replace(loud, noise=2.0)}.get(verdict, loud)
    return Facts(Limits(), answer or (SimpleNamespace(shown=True),), loud, after)


def model_of(*terms: Term) -> Any:
    """What stands in for a scored model with these terms."""
    return SimpleNamespace(fit=SimpleNamespace(terms=terms))


def test_an_effect_is_exchanged_on_the_latest_model_without_it_or_on_a_new_fit() -> None:
    had, moved = (Term(EFFECTS["winch_gain"], None, (share,)) for share in (0.1, 0.2))
    found = Term(EFFECTS["cable_damping"], None, (500.0,))
    models = [model_of(had), model_of(moved), model_of(moved, found)]
    search: Any = SimpleNamespace(
        linearised=lambda fit: ("linearised", fit), dropped=lambda fit, term: term
    )
    last = models[-1].fit
    assert alternatives.model_without(search, models[:-1], last, [found]) is models[1]
    assert alternatives.model_without(search, models[:-1], last, [moved]) == ("linearised", moved)


@pytest.mark.slow
def test_of_alternatives_that_are_one_by_several_names_one_is_fitted(
    robot: Robot, fitter: PlantFitter, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("command_delay", "sensor_latency")
    library = candidates(robot, {name: EFFECTS[name] for name in (*names, "winch_gain")})
    search = Search(fitter, library)
    found = Term(EFFECTS["winch_gain"], None, (0.05,))
    last = fitter.with_terms(fitted(fitter, rounds=1), (found,))
    late = float(np.random.default_rng(seed).uniform(0.005, 0.03))
    scores = [
        Score(each, 0, 0.0, 0.0, (late / each.typical[0],), 0.0)
        for each in library
        if each.effect.name in names
    ]
    fitted_on: list[str] = []

    def fit_until(_: Search, fit: Fit, *__: float | None) -> Fit:
        fitted_on.append(fit.terms[-1].effect.name)
        return fit

    monkeypatch.setattr(Search, "fit_until", fit_until)
    as_good = alternatives._in_place(search, last, found, scores, np.inf, False)
    assert fitted_on == [scores[0].candidate.effect.name], seed
    assert {fit.terms[-1].effect.name for fit in as_good} == {*names}, seed
    assert as_good[0].cost == pytest.approx(as_good[1].cost, rel=1e-6), seed


@pytest.mark.parametrize("verdict", [Verdict.PARTIAL, Verdict.OUTSIDE_LIBRARY])
def test_of_two_effects_that_predict_the_same_an_answer_names_both_whatever_else_is_left(
    verdict: Verdict, seed: int
) -> None:
    robot = load_robot("platform4")
    names = ("command_delay", "sensor_latency", "winch_gain")
    late = Term(EFFECTS["command_delay"], None, (0.03,))
    log = recorded(robot, (late,), seed)
    fitter = fitter_of(Windows.cut(robot, [log], seconds=0.4), Plant(robot))
    search = Search(fitter, candidates(robot, {name: EFFECTS[name] for name in names}))
    first = search.score_all(fitter.first_estimate())
    last = search.score_all(fitter.with_terms(first.fit, (late,)))
    searched: Any = SimpleNamespace(search=search)
    begun = conclusion.Judged([first, last], (), facts_of(verdict))
    assert begun.verdict is verdict
    (rival,) = conclusion.with_rivals(searched, begun).rivals
    (other,) = rival.terms
    assert (other.effect.name, other.values) == ("sensor_latency", late.values), seed
    assert rival.cost == pytest.approx(last.fit.cost, rel=1e-9), seed
    known = replace(begun, exchanged=True)
    assert conclusion.with_rivals(searched, known) is known


def test_values_that_another_effect_cannot_have_make_no_twin(robot, fitter, seed):
    """A gain may be negative, a delay not."""
    (late,) = candidates(robot, {"command_delay": EFFECTS["command_delay"]})
    search = Search(fitter, (late,))
    gain = Term(EFFECTS["winch_gain"], None, (-0.05,))
    last = fitter.with_terms(fitter.first_estimate(), (gain,))
    score: Any = SimpleNamespace(candidate=late, sizes=(0.01,), shape=0)
    assert alternatives._twin(search, last, gain, score) is None, seed


@pytest.mark.parametrize(("costs", "left"), [((130.0, 124.0), 1), ((130.0, 126.0), None)])
def test_an_effect_goes_that_turns_out_not_to_be_needed(fitter, costs, left):
    """With the better initial states that were found meanwhile; each has to explain 25 here."""
    search = Search(fitter, ())
    terms = tuple(Term(EFFECTS[n], None, (0.1,)) for n in ("winch_gain", "cable_friction"))
    last = replace(fitter.first_estimate(), cost=100.0)
    models: list[Any] = [SimpleNamespace(fit=replace(last, cost=cost)) for cost in costs]
    found = ExchangedModels(last, (), tuple(zip(terms, models, strict=True)))
    assert found.shorter(search) is (None if left is None else models[left])
    alone = ExchangedModels(last, (), ((terms[1], models[1]),))
    assert alone.shorter(search) is None  # without the only one nothing is left
    kept = KeptColumns({}, np.zeros((1, 1, 0)))
    cache = replace(fitter.cached(fitter.rough_jacobian(last)), kept=kept)
    built = replace(
        alone, last=replace(last, cache=cache)
    )  # beside numbers that are all a little off
    assert built.shorter(search) is (models[1] if costs[1] < 125.0 else None)


def test_an_answer_is_judged_without_what_is_not_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = (Term(EFFECTS[name], None, (0.1,)) for name in ("winch_gain", "cable_friction"))
    first, shorter, other, last = (model_of(*terms) for terms in ((), (b,), (a,), (a, b)))
    exchanges = iter([SimpleNamespace(shorter=lambda _: shorter)])
    judged: list[Any] = []

    def judge(_: Any, models: list[Any]) -> Any:
        judged.append(models)
        return SimpleNamespace(models=models, verdict=Verdict.NOISE_ONLY)

    monkeypatch.setattr(conclusion, "exchanged", lambda *_: next(exchanges))
    monkeypatch.setattr(conclusion, "judge", judge)
    searched: Any = SimpleNamespace(search=None)
    begun: Any = SimpleNamespace(models=[first, other, last], verdict=Verdict.EFFECT)
    concluded = conclusion.with_alternatives(searched, begun)
    assert judged == [[first, shorter]]
    assert concluded.models == [first, shorter]


def test_a_shortened_answer_loses_what_is_not_shown_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the whole one would, whose intervals are others."""
    names = ("winch_gain", "cable_friction", "cable_damping")
    a, b, c = (Term(EFFECTS[name], None, (0.1,)) for name in names)

    def judge(_: Any, models: list[Any]) -> Any:
        terms = models[-1].fit.terms
        answer = [SimpleNamespace(term=t, shown=t is not b, certainty=0.1) for t in terms]
        facts = SimpleNamespace(answer=answer)
        return SimpleNamespace(models=models, facts=facts, verdict=Verdict.NOISE_ONLY)

    exchange = SimpleNamespace(shorter=lambda _: model_of(a, b))
    monkeypatch.setattr(conclusion, "exchanged", lambda *_: exchange)
    monkeypatch.setattr(conclusion, "judge", judge)
    search = SimpleNamespace(
        begun_without=lambda fit, term: model_of(*(t for t in fit.terms if t is not term)).fit,
        fit_until=lambda fit: fit,
        score_all=lambda fit: model_of(*fit.terms),
    )
    searched: Any = SimpleNamespace(search=search)
    models = [model_of(), model_of(a), model_of(a, b, c)]
    begun: Any = SimpleNamespace(models=models, verdict=Verdict.EFFECT)
    concluded = conclusion.with_alternatives(searched, begun)
    assert [each.fit.terms for each in concluded.models] == [(), (a,)]


@pytest.mark.parametrize(
    ("verdict", "kept", "share", "left"),
    [
        (Verdict.PARTIAL, False, 9.0, ["a"]),
        (Verdict.PARTIAL, True, 9.0, ["a"]),
        (Verdict.EFFECT, True, 9.0, ["a", "b"]),
        (Verdict.EFFECT, True, 0.9, ["a"]),  # numbers of a robot as built make up for it
        (Verdict.EFFECT, False, 0.9, ["a", "b"]),  # that was asked before
    ],
)
def test_where_a_model_is_wrong_anyway_an_effect_has_to_gain_something_elsewhere(
    monkeypatch: pytest.MonkeyPatch, verdict: Verdict, kept: bool, share: float, left: list[str]
) -> None:
    """Of two, b gains nothing on windows that were not fitted, and explains a share of what counts."""
    terms = {
        "a": Term(EFFECTS["winch_gain"], None, (0.1,)),
        "b": Term(EFFECTS["cable_friction"], None, (0.1,)),
    }

    def model(*names: str) -> Any:
        fit = SimpleNamespace(
            terms=tuple(terms[n] for n in names), kept=kept or None, converged=True, cost=0.0
        )
        return SimpleNamespace(fit=fit, names=set(names))

    class Unseen:
        def __init__(self, *_: Any) -> None: ...

        def gain(self, without: Any, model: Any) -> Gain:
            clear = model.names - without.names == {"a"}
            return Gain(0.5 if clear else 0.01, 0.3 if clear else -0.1, 0.6, clear, 9, 0)

        gain_everywhere = gain

    def judge(_: Any, models: list[Any]) -> Any:
        terms = models[-1].fit.terms
        answer = [SimpleNamespace(effect=t.effect.name, term=t, shown=True) for t in terms]
        return conclusion.Judged(models, (), facts_of(verdict, tuple(answer)))

    monkeypatch.setattr(conclusion, "UnseenWindows", Unseen)
    monkeypatch.setattr(conclusion, "judge", judge)
    monkeypatch.setattr(conclusion, "replace", _replaced)
    search = SimpleNamespace(
        fitter=None,
        threshold=25.0,
        criterion=lambda fit: fit.cost,
        settled=lambda fit, target: fit,
        fit_until=lambda fit: fit,
        scored=lambda model: model,
        share=lambda fit, less, term: share if term is terms["b"] else 9.0,
    )
    searched: Any = SimpleNamespace(search=search)
    models = [model(), model("a"), model("a", "b")]
    begun = replace(judge(None, models), shorter=(model("b"),))
    judged = conclusion.with_gains(searched, begun, None)
    assert [name for name in terms if terms[name] in judged.models[-1].fit.terms] == left
    assert all(each.gain is not None for each in judged.facts.answer)
    assert judged.facts.gain is not None
    assert judged.facts.gain.clear == (
        left == ["a"]
    )  # of both together, this double says that of b


@pytest.mark.parametrize(
    ("less", "promised", "ends"),
    [(60.0, 99.0, 50.0), (90.0, 99.0, None), (60.0, 20.0, None), (60.0, 99.0, 80.0)],
)
def test_a_model_that_costs_more_than_one_without_an_effect_begins_where_that_ended(
    monkeypatch: pytest.MonkeyPatch, less: float, promised: float, ends: float | None
) -> None:
    """One that costs 100 begins anew where one without its effect clearly ended lower, and where the
    effect is visible beside that; so it has to end.
    """
    term = Term(EFFECTS["winch_gain"], None, (0.1,))
    begun: list[Any] = []

    def warm_start(model: Any, terms: Any) -> Any:
        begun.append((model, terms))
        return SimpleNamespace(cost=ends)

    search: Any = SimpleNamespace(
        threshold=25.0,
        fitter=SimpleNamespace(with_terms=lambda fit, terms: fit),
        least_explained=lambda term: 25.0,
        warm_start=warm_start,
        fit_until=lambda fit: fit,
        settled=lambda fit: fit,
    )
    explained = SimpleNamespace(explained=promised)
    monkeypatch.setattr(conclusion, "promised", lambda *_: explained)
    shorter, worse = (SimpleNamespace(fit=SimpleNamespace(terms=(), cost=c)) for c in (less, 99.0))
    fit: Any = SimpleNamespace(terms=(term,), cost=100.0)
    found = conclusion._from_shorter(search, fit, [worse, shorter], [[], [term]])
    assert begun == ([] if ends is None else [(shorter, (term,))])
    assert (found.cost if found else None) == (50.0 if ends == 50.0 else None)


def _replaced(record: Any, **changes: Any) -> Any:
    """`dataclasses.replace`, of doubles, too."""
    if isinstance(record, SimpleNamespace):
        return SimpleNamespace(**{**vars(record), **changes})
    return replace(record, **changes)
