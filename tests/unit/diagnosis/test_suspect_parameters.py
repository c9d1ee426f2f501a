"""Which numbers of an MJCF are suspected where an effect seems to be missing."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flywheel.diagnosis.checks.suspect_parameters import (
    SuspectParameter,
    _scores,
    far_off_parameters,
    suspect_parameters,
)
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.nuisance import unsure_terms
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.scores import ScoredModel, further_scores
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import Limits
from flywheel.dynamics.plant import Plant, PlantParameters
from flywheel.effects import CALIBRATIONS, EFFECTS, Term, Terms
from flywheel.reports.diagnosis_page import suspects
from flywheel.robots import Robot, load_robot
from tests.unit.diagnosis.conftest import recorded

SUSPECTS = "flywheel.diagnosis.checks.suspect_parameters"
pytestmark = pytest.mark.slow

FEW = {"winch_gain": EFFECTS["winch_gain"]}  # which is unlike the numbers in any recording
OFF = 0.08
MOST = Limits().most
Scored = tuple[Search, ScoredModel]


def scored(robot: Robot, seed: int, hidden: Terms = (), had: Terms = (), **scales: float) -> Scored:
    """A plant with other numbers, scored on a recording of a robot with hidden effects."""
    told = Plant(robot, parameters=PlantParameters(**scales))
    # Some drawn motions tell little of a stiffness or a mass: with little noise, all tell enough.
    log = recorded(robot, hidden, seed, noise=0.0004)
    fitter = fitter_of(Windows.cut(robot, [log], seconds=0.4), told)
    search = Search(fitter, candidates(robot, FEW))
    return search, search.score_all(fitted(fitter, had))


@pytest.fixture(scope="module")
def stiffer(robot: Robot, seed: int) -> Scored:
    return scored(robot, seed, cable_stiffness=1.0 / (1.0 + OFF))


def named(
    search: Search, *models: ScoredModel, unexplained: bool = False
) -> dict[str, SuspectParameter]:
    return {each.name: each for each in suspect_parameters(search, models, unexplained)}


def with_added(
    model: ScoredModel, effect: str = "winch_gain", explained: float = 0.0
) -> ScoredModel:
    """A model with an effect more, that explained so much."""
    term = Term(EFFECTS[effect], None, (0.01,))
    cost = model.fit.cost - explained
    return replace(model, fit=replace(model.fit, terms=(*model.fit.terms, term), cost=cost))


def test_a_wrong_stiffness_is_suspected(stiffer: Scored, seed: int) -> None:
    search, model = stiffer
    found = named(search, model, with_added(model))["cable_stiffness"]
    assert found.off == pytest.approx(OFF, abs=0.04), seed
    assert (found.more, found.instead) == (True, "winch_gain"), seed
    assert found.summary()["off"] == found.off


def test_a_wrong_mass_is_suspected(robot: Robot, seed: int) -> None:
    search, model = scored(robot, seed, mass=1.0 / (1.0 + OFF))
    found = named(search, model, with_added(model))["body_mass"]
    assert found.off == pytest.approx(OFF, abs=0.04), seed


def test_it_is_compared_with_what_an_effect_explained_not_with_what_scores_promised(stiffer, seed):
    search, model = stiffer
    (statistic,) = (
        score.statistic
        for score in _scores(search, model)
        if score.candidate.effect.name == "cable_stiffness"
    )
    nearly = named(search, model, with_added(model, explained=1.1 * statistic))
    assert not nearly["cable_stiffness"].more, seed
    assert not named(search, model, with_added(model, explained=2.0 * statistic)), seed


def test_what_is_asked_about_is_not_suspected_as_well(stiffer: Scored) -> None:
    search, model = stiffer
    numbers = candidates(search.fitter.windows.robot, CALIBRATIONS)
    asking_all = Search(search.fitter, (*search.library, *numbers))
    assert not named(asking_all, model, with_added(model), unexplained=True)


def test_beside_an_answer_it_is_asked_only_of_what_that_leaves(stiffer: Scored, seed: int) -> None:
    search, model = stiffer
    assert not named(search, model), seed
    assert named(search, model, unexplained=True)["cable_stiffness"].instead == "", seed


def test_no_number_is_suspected_where_an_effect_explains_far_more(robot: Robot, seed: int) -> None:
    search, model = scored(robot, seed, (Term(EFFECTS["winch_gain"], None, (0.3,)),))
    assert model.scores[0].candidate.effect.name == "winch_gain", seed
    assert not named(search, model, with_added(model)), seed


def test_it_is_asked_in_the_time_steps_of_the_end(stiffer, monkeypatch):
    """The first model's may have been longer, and what changes with them is no number's doing."""
    search, model = stiffer
    finer = search.fitter.halved(np.ones(len(search.fitter.windows), bool))
    costs: list[float] = []

    def observed(fitter: Fitter, fit: Fit, *rest: Any) -> Any:
        assert fitter is finer
        costs.append(fit.cost)
        return further_scores(fitter, fit, *rest)

    monkeypatch.setattr(f"{SUSPECTS}.further_scores", observed)
    _scores(Search(finer, search.library), model)
    assert costs == [pytest.approx(finer.with_terms(model.fit, model.fit.terms).cost, rel=1e-9)]
    assert costs[0] != pytest.approx(model.fit.cost, rel=1e-9)


def test_what_somebody_is_unsure_of_is_not_suspected_again(stiffer: Scored) -> None:
    search, model = stiffer
    had = unsure_terms({"cable_stiffness": 0.02})
    unsure = replace(model, fit=replace(model.fit, terms=had))
    names = {score.candidate.effect.name for score in _scores(search, unsure)}
    whole = {name for name, number in CALIBRATIONS.items() if number.where == "robot"}
    assert names == whole - {"cable_stiffness"}


def test_a_number_that_would_have_to_be_far_off_is_not_suspected(
    stiffer: Scored, monkeypatch
) -> None:
    search, model = stiffer
    monkeypatch.setattr(f"{SUSPECTS}.MOST_OFF", 0.25 * OFF)
    assert not named(search, model, with_added(model))


@pytest.mark.parametrize("times", [3.0, 8.0])
def test_a_stiffness_that_is_several_times_the_told_one_is_fitted_and_named(seed, times):
    search, model = scored(load_robot("platform4"), seed, cable_stiffness=1.0 / times)
    (found,) = (
        each for each in far_off_parameters(search, [model], MOST) if each.name == "cable_stiffness"
    )
    assert 1.0 + found.off == pytest.approx(times, rel=0.1), seed
    assert found.explained == pytest.approx(1.0, abs=0.1), seed
    assert found.more and not found.at_bound and not found.instead
    told: Any = SimpleNamespace(suspects=(found,))
    assert f"cable_stiffness of {1.0 + found.off:.3g} times" in suspects(told)
    # Asked for as an effect, whose bounds are narrower, it is not left to another number.
    numbers = candidates(search.fitter.windows.robot, {found.name: CALIBRATIONS[found.name]})
    asking = replace(search, library=(*search.library, *numbers))
    assert far_off_parameters(asking, [model], MOST)[0] == found
    # An answer that explains all is no worse than the number.
    answer = replace(model, fit=replace(model.fit, cost=search.fitter.freedom))
    assert not far_off_parameters(search, [model, answer], MOST)


def test_a_number_at_its_bound_comes_after_one_that_explains_within_its_bounds(
    stiffer, monkeypatch
):
    search, model = stiffer

    def alone(_, begun, score):
        effect, (typical,) = score.candidate.effect, score.candidate.typical
        mass = effect.name == "body_mass"
        off = effect.sizes[0].low * typical if mass else 3.0
        fit, terms = begun.fit, (*begun.fit.terms, Term(effect, None, (off,)))
        return replace(fit, terms=terms, cost=fit.cost - (2000.0 if mass else 1000.0))

    monkeypatch.setattr("flywheel.diagnosis.checks.suspect_parameters._fitted_alone", alone)
    first, last = far_off_parameters(search, [model], MOST)
    assert (first.name, last.name) == ("cable_stiffness", "body_mass") and last.at_bound
    words = suspects(SimpleNamespace(suspects=(first, last)))
    assert words.index("cable_stiffness of 4 times") < words.index(
        "body_mass of 0.25 times explains"
    )


def test_a_number_at_its_bound_is_said_to_be_there() -> None:
    number = SuspectParameter("cable_stiffness", 19.0, 9.0, "creep", True, 0.9, 40.0, True)
    words = suspects(SimpleNamespace(suspects=(number,)))  # type: ignore[arg-type]
    assert "20 times what it says, with 40 N s/m more damping" in words
    assert "more than creep" in words and "the bound of its fit" in words


def test_a_person_is_told_what_to_do() -> None:
    found: Any = SimpleNamespace(
        suspects=(
            SuspectParameter("cable_stiffness", 0.0597, 504.3, "ground_friction", more=True),
            SuspectParameter("body_mass", -0.054, 400.5, "ground_friction", more=True),
        )
    )
    said = suspects(found)
    assert (
        "6.0% more of cable_stiffness would explain more than ground_friction (score 504)" in said
    )
    assert "Another body_mass would explain about as much." in said
    assert said.endswith("--unsure cable_stiffness=6%.")
    beside: Any = SimpleNamespace(
        suspects=(SuspectParameter("body_mass", -0.003, 30.0, "", more=False),)
    )
    assert "0.3% less of body_mass would explain some of the residual" in suspects(beside)
    assert suspects(beside).endswith("--unsure body_mass=1%.")
    assert suspects(SimpleNamespace(suspects=())) == ""  # type: ignore[arg-type]
