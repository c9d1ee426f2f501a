"""An effect of another form is named as what it is, and no second effect is named for the difference."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flywheel.diagnosis import Diagnosis, Verdict, diagnose
from flywheel.diagnosis.checks.held_out import HeldOut
from flywheel.diagnosis.diagnose import _searched
from flywheel.diagnosis.fitting.model import ModelUnderTest, fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.heartbeat import Heartbeat
from flywheel.diagnosis.judgement import judge, without_unclear_factors
from flywheel.diagnosis.results.answer import Answer
from flywheel.diagnosis.selection import other_forms as module
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.proposals import promising_forms
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import SelectionSettings
from flywheel.dynamics.plant import Plant
from flywheel.effects import (
    EFFECTS,
    FORMS,
    NAMED,
    Cables,
    Effect,
    Parameter,
    PerPart,
    Scales,
    TensionEffect,
    Term,
    per_part_term,
)
from flywheel.effects.effect import Memory, Values
from flywheel.options import DiagnosisOptions
from flywheel.records import Floats
from flywheel.reports.diagnosis_page import diagnosis_page, forms, sentence
from flywheel.robots import Robot, load_robot
from tests.unit.diagnosis.conftest import QUICK, recorded

ROBOT = "platform4"
PROPOSALS = "flywheel.diagnosis.selection.proposals"

FEW = {name: EFFECTS[name] for name in ("cable_friction", "capstan", "winch_gain", "weak_cable")}
FACTORS = (0.5, -0.9, 0.3, -0.5)  # logarithms


def of(robot: Robot, effect: Effect, times: float) -> Term:
    return Term(effect, None, (times * effect.sizes[0].typical(Scales.of(robot)),))


def diagnosed(robot: Robot, hidden: Term, seed: int, recordings: int = 2) -> Diagnosis:
    logs = [recorded(robot, (hidden,), seed + i) for i in range(recordings)]
    return diagnose(Plant(robot), logs, (), FEW, QUICK, DiagnosisOptions(0.4, seed=seed))


@pytest.mark.nightly
@pytest.mark.slow
def test_friction_that_differs_from_cable_to_cable_is_one_effect(robot: Robot, seed: int) -> None:
    even = of(robot, EFFECTS["cable_friction"], 8.0)
    hidden = per_part_term(even, robot, 0.5)
    assert hidden is not None
    hidden = replace(hidden, values=even.values + FACTORS)
    found = diagnosed(robot, hidden, seed, 4)
    (answer,) = found.answers[0]
    assert answer.effect == "cable_friction" and isinstance(answer.term.effect, PerPart), seed
    true = even.values[0] * np.exp(FACTORS)
    assert found.verdict is Verdict.EFFECT, seed
    sizes = [part.value for part in answer.by_part]
    np.testing.assert_allclose(sizes[1:], true[1:], rtol=0.1)
    wide = [part.high / part.low for part in answer.by_part]
    # The first cable is often slack: its size is hardly seen, and that is said.
    assert np.argmax(wide) == 0
    assert "different from cable to cable" in sentence(found)
    page = diagnosis_page(found, {})
    assert all(part.name in page for part in answer.by_part) and "log_factor" not in page
    read = Answer.of(found.summary()).chosen(None)[0].written().term(robot, NAMED)
    assert read.values == answer.term.values and isinstance(read.effect, PerPart)


@pytest.mark.slow
def test_winches_that_wind_up_less_than_they_are_told_have_a_gain(robot: Robot, seed: int) -> None:
    """Servo motors do: the gain of the rates of a position winch says nothing of where it ends."""
    found = diagnosed(robot, of(robot, FORMS["winch_gain_on_length"], -1.0), seed)
    (answer,) = found.answers[0]
    assert answer.effect == "winch_gain_on_length" and answer.family == "winch_gain", seed
    assert found.verdict is Verdict.EFFECT, seed
    assert answer.term.values[0] == pytest.approx(-0.1, abs=0.01), seed
    assert "on the length that is wound up" in sentence(found)


def test_sizes_that_gain_nothing_elsewhere_become_one_size(robot: Robot, seed: int) -> None:
    hidden = of(robot, EFFECTS["cable_friction"], 4.0)
    logs = [recorded(robot, (hidden,), seed + i) for i in range(2)]
    heartbeat = Heartbeat()
    under_test = ModelUnderTest(Plant(robot), None, seed, heartbeat.again, QUICK)
    searched = _searched(under_test, logs, 0.4, candidates(robot, FEW), (), heartbeat)
    search, last = searched.search, searched.models[-1].fit
    (term,) = last.terms
    uneven = per_part_term(term, robot, 0.5)
    assert uneven is not None
    fit = search.fit_until(search.fitter.with_terms(last, (uneven,)))
    judged = judge(searched, [searched.models[0], search.score_all(fit)])
    held_out = HeldOut(under_test, [recorded(robot, (hidden,), seed + 9)], search.fitter.windows)
    (answer,) = without_unclear_factors(searched, judged, held_out).facts.answer
    assert isinstance(judged.facts.answer[0].term.effect, PerPart) and not answer.by_part, seed
    assert answer.term.values == pytest.approx(term.values, rel=0.02)


@pytest.mark.nightly
def test_a_form_that_is_not_decided_is_said(robot: Robot, seed: int) -> None:
    found = diagnosed(robot, of(robot, EFFECTS["cable_friction"], 4.0), seed)
    (answer,) = found.answers[0]
    assert answer.effect == "cable_friction" and not answer.form and not answer.by_part
    assert not found.other_forms and not forms(found)  # all cables of this robot are equally stiff
    law = of(robot, FORMS["cable_friction_by_stiffness"], 4.0)
    other = replace(found.answers[0][0], effect=law.effect.name, term=law)
    open_ = replace(found, other_forms=((other,),))
    assert law.effect.form in forms(open_) and forms(open_) in diagnosis_page(open_, {})
    assert open_.summary()["other_forms"][0][0]["family"] == "cable_friction"
    assert open_.verdict is Verdict.EFFECT
    gain = of(robot, EFFECTS["winch_gain"], 1.0)
    beside = replace(answer, effect=gain.effect.name, term=gain)
    both = replace(found, answers=((answer, beside),), other_forms=((other, beside),))
    assert forms(both) == forms(open_)  # what is the same in all of them is decided


@pytest.mark.parametrize(
    ("beyond_noise", "asked"), [(90.0, ["other law"]), (900.0, ["at one part", "other law"])]
)
def test_a_law_that_promises_clearly_more_is_fitted_whatever_the_best_candidate_promises(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, beyond_noise: float, asked: list[str]
) -> None:
    """What is simulated for it, effects at one part alone, is not where the best explains nearly all."""

    def score(name: str, statistic: float, form: str = "") -> Any:
        effect = SimpleNamespace(form=form, family="creep", name=name)
        candidate = SimpleNamespace(effect=effect, term=lambda *_: name)
        return SimpleNamespace(candidate=candidate, statistic=statistic, sizes=(), shape=0)

    best = score("creep", 100.0)
    laws = [score("other law", 130.0, "on length"), score("weaker law", 110.0, "by tension")]
    monkeypatch.setattr(f"{PROPOSALS}.further_scores", lambda *_: [score("at one part", 140.0)])
    search: Any = SimpleNamespace(
        settings=SelectionSettings(),
        library=[best.candidate],
        fitter=SimpleNamespace(windows=SimpleNamespace(robot=robot)),
    )
    monkeypatch.setattr(f"{PROPOSALS}.at_parts", lambda *_: ())
    model: Any = SimpleNamespace(
        scores=[best], probes=laws, beyond_noise=beyond_noise, fit=None, test=None
    )
    assert [each.candidate.effect.name for each in promising_forms(search, model)] == asked


class TwoWays(TensionEffect):
    """Two sizes, and a shape of two values."""

    name = "two_ways"
    sizes = (
        Parameter("constant", "N", lambda s: 0.05 * s.weight, low=-20.0),
        Parameter("damping", "N s/m", lambda s: 0.5 * s.weight * s.time / s.length, low=-20.0),
    )
    shapes = (Parameter("speed", "m/s", lambda s: 0.01 * s.length / s.time, grid=(0.3, 3.0)),)
    equation, source, shown_by = "dT = F tanh(V / v) + c V", "made up", "strokes"

    def tension(self, cables: Cables, memory: Memory, values: Values) -> tuple[Floats, Memory]:
        dry = values["constant"] * np.tanh(cables.speed / np.maximum(values["speed"], 1e-9))
        return dry + values["damping"] * cables.speed, memory


def test_a_rival_of_any_number_of_sizes_and_shapes_takes_the_place_of_an_effect(robot, seed):
    """It begins with the sizes that change what the effect changed: here it can do just that."""
    hidden = of(robot, EFFECTS["cable_damping"], 1.0)
    windows = Windows.cut(robot, [recorded(robot, (hidden,), seed)], seconds=0.4)
    fitter = fitter_of(windows, Plant(robot))
    fit = fitter.first_estimate((hidden,))
    (rival,) = candidates(robot, {"two_ways": TwoWays()})
    search = Search(fitter, (rival,))
    (term,) = module._exchanged(search, fit, hidden, rival)
    constant, damping, speed = term.values
    assert damping == pytest.approx(hidden.values[0], rel=1e-3), seed
    assert abs(constant) < 1e-3 * rival.typical[0], seed
    assert speed in [shape[0] for shape in rival.shapes]
    assert module._fitted_in_place(search, fit, hidden, rival).cost <= fit.cost * 1.001


def test_a_law_that_a_robot_cannot_show_is_not_asked_about(robot: Robot) -> None:
    law = FORMS["cable_friction_by_stiffness"]
    assert law.differs_on(load_robot("prism3")) and not law.differs_on(robot)
    assert FORMS["creep_on_length"].differs_on(robot)
    gain = FORMS["winch_gain_on_length"]
    assert gain.differs_on(robot) and not gain.differs_on(load_robot("prism3"))
