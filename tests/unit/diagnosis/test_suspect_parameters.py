"""Which numbers of an MJCF are doubted where an effect seems to be missing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flywheel.diagnosis.fitting.baseline import fitted, fitter_of
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.nuisance import unsure_terms
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection import score_test as score
from flywheel.diagnosis.selection import suspect_parameters as asking
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.step import Step
from flywheel.diagnosis.selection.stepwise import Selection
from flywheel.diagnosis.selection.suspect_parameters import Doubtful, doubtful_numbers
from flywheel.dynamics.plant import Plant, PlantParameters
from flywheel.effects import CALIBRATIONS, EFFECTS, Term, Terms
from flywheel.reports.diagnosis_page import doubtful
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded

FEW = {"winch_gain": EFFECTS["winch_gain"]}  # which is unlike the numbers in any recording
OFF = 0.08
Looked = tuple[Selection, Step]


def looked(robot: Robot, seed: int, hidden: Terms = (), had: Terms = (), **scales: float) -> Looked:
    """At a recording of a robot with hidden effects, by a plant with other numbers."""
    told = Plant(robot, parameters=PlantParameters(**scales))
    # Some drawn motions tell little of a stiffness or a mass: with little noise, all tell enough.
    log = recorded(robot, hidden, seed, noise=0.0004)
    fitter = fitter_of(Windows.cut(robot, [log], seconds=0.4), told)
    selection = Selection(fitter, candidates(robot, FEW), 25.0)
    return selection, selection.look(fitted(fitter, had))


@pytest.fixture(scope="module")
def stiffer(robot: Robot, seed: int) -> Looked:
    return looked(robot, seed, cable_stiffness=1.0 / (1.0 + OFF))


def named(selection: Selection, *steps: Step, unexplained: bool = False) -> dict[str, Doubtful]:
    return {each.name: each for each in doubtful_numbers(selection, steps, unexplained)}


def with_added(step: Step, effect: str = "winch_gain", explained: float = 0.0) -> Step:
    """A step with an effect more, that explained so much."""
    term = Term(EFFECTS[effect], None, (0.01,))
    cost = step.fit.cost - explained
    return replace(step, fit=replace(step.fit, terms=(*step.fit.terms, term), cost=cost))


def test_a_wrong_stiffness_is_doubted(stiffer: Looked, seed: int) -> None:
    selection, step = stiffer
    found = named(selection, step, with_added(step))["cable_stiffness"]
    assert found.off == pytest.approx(OFF, abs=0.04), seed
    assert (found.more, found.instead) == (True, "winch_gain"), seed
    assert found.summary()["off"] == found.off


def test_a_wrong_mass_is_doubted(robot: Robot, seed: int) -> None:
    selection, step = looked(robot, seed, mass=1.0 / (1.0 + OFF))
    found = named(selection, step, with_added(step))["body_mass"]
    assert found.off == pytest.approx(OFF, abs=0.04), seed


def test_it_is_compared_with_what_an_effect_explained_not_with_what_scores_promised(
    stiffer: Looked, seed: int
) -> None:
    selection, step = stiffer
    (power,) = (
        score.power
        for score in asking._scores(selection, step)
        if score.candidate.effect.name == "cable_stiffness"
    )
    nearly = named(selection, step, with_added(step, explained=1.1 * power))
    assert not nearly["cable_stiffness"].more, seed
    assert not named(selection, step, with_added(step, explained=2.0 * power)), seed


def test_what_is_asked_about_is_not_doubted_as_well(stiffer: Looked) -> None:
    selection, step = stiffer
    numbers = candidates(selection.fitter.windows.robot, CALIBRATIONS)
    asking_all = Selection(selection.fitter, (*selection.library, *numbers), 25.0)
    assert not named(asking_all, step, with_added(step), unexplained=True)


def test_beside_an_answer_it_is_asked_only_of_what_that_leaves(stiffer: Looked, seed: int) -> None:
    selection, step = stiffer
    assert not named(selection, step), seed
    assert named(selection, step, unexplained=True)["cable_stiffness"].instead == "", seed


def test_no_number_is_doubted_where_an_effect_explains_far_more(robot: Robot, seed: int) -> None:
    selection, step = looked(robot, seed, (Term(EFFECTS["winch_gain"], None, (0.3,)),))
    assert step.scores[0].candidate.effect.name == "winch_gain", seed
    assert not named(selection, step, with_added(step)), seed


def test_it_is_asked_in_the_time_steps_of_the_end(
    stiffer: Looked, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first step's may have been longer, and what changes with them is no number's doing."""
    selection, step = stiffer
    finer = selection.fitter.refined(np.ones(len(selection.fitter.windows), bool))
    costs: list[float] = []

    def sensitivities(fitter: Fitter, fit: Fit, *rest: Any) -> Any:
        assert fitter is finer
        costs.append(fit.cost)
        return score.sensitivities(fitter, fit, *rest)

    monkeypatch.setattr(asking, "sensitivities", sensitivities)
    asking._scores(Selection(finer, selection.library, 25.0), step)
    assert costs == [pytest.approx(finer.under(step.fit, step.fit.terms).cost, rel=1e-9)]
    assert costs[0] != pytest.approx(step.fit.cost, rel=1e-9)


def test_what_somebody_is_unsure_of_is_not_doubted_again(stiffer: Looked) -> None:
    selection, step = stiffer
    had = unsure_terms({"cable_stiffness": 0.02})
    unsure = replace(step, fit=replace(step.fit, terms=had))
    names = {score.candidate.effect.name for score in asking._scores(selection, unsure)}
    assert names == set(CALIBRATIONS) - {"cable_stiffness"}


def test_a_number_that_would_have_to_be_far_off_is_not_doubted(
    stiffer: Looked, monkeypatch: pytest.MonkeyPatch
) -> None:
    selection, step = stiffer
    monkeypatch.setattr(asking, "LIKELY", 0.25 * OFF)
    assert not named(selection, step, with_added(step))


def test_a_person_is_told_what_to_do() -> None:
    found: Any = SimpleNamespace(
        doubtful=(
            Doubtful("cable_stiffness", 0.0597, 504.3, "ground_friction", more=True),
            Doubtful("body_mass", -0.054, 400.5, "ground_friction", more=True),
        )
    )
    said = doubtful(found)
    assert (
        "6.0% more of cable_stiffness would explain more than ground_friction (score 504)" in said
    )
    assert "Another body_mass would explain about as much." in said
    assert said.endswith("--unsure cable_stiffness=6%.")
    beside: Any = SimpleNamespace(doubtful=(Doubtful("body_mass", -0.003, 30.0, "", more=False),))
    assert "0.3% less of body_mass would explain some of what is left" in doubtful(beside)
    assert doubtful(beside).endswith("--unsure body_mass=1%.")
    assert doubtful(SimpleNamespace(doubtful=())) == ""  # type: ignore[arg-type]
