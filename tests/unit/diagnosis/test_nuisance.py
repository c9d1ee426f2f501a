"""What the MJCF says only so well is fitted, and not taken for an effect."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flywheel.diagnosis import diagnose
from flywheel.diagnosis.adoption import adoptable
from flywheel.diagnosis.fitting.model import fitted, fitted_as_given, fitter_of
from flywheel.diagnosis.fitting.nuisance import STARTS, calibrated, unsure_terms
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import FittingSettings
from flywheel.dynamics.plant import AugmentedPlant, Plant, PlantParameters
from flywheel.effects import CALIBRATIONS, EFFECTS, NAMED, Term
from flywheel.errors import DataError, UnknownNameError
from flywheel.options import DiagnosisOptions
from flywheel.reports.diagnosis_page import diagnosis_page, held_back
from flywheel.robots import Robot, load_robot
from tests import draws
from tests.unit.diagnosis.conftest import QUICK, recorded

ROBOT = "platform4"

FEW = {name: EFFECTS[name] for name in ("winch_gain", "stiffening")}
SCALES = {"cable_stiffness": "cable_stiffness", "body_mass": "mass"}  # of the plant


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scale", "name"), [("cable_stiffness", "cable_stiffness"), ("mass", "body_mass")]
)
def test_a_wrong_number_is_fitted_and_not_taken_for_an_effect(robot, seed, scale, name):
    logs = [recorded(robot, (), seed + i) for i in range(2)]
    told = Plant(robot, parameters=PlantParameters(**{scale: 1 / 1.06}))
    unsure = {name: 0.05}
    found = diagnose(
        told, logs[:1], logs[1:], FEW, QUICK, DiagnosisOptions(0.4, seed=seed), unsure=unsure
    )
    assert not any(found.answers), (seed, found.verdict)
    (value,) = found.calibration[0].values
    assert value.low - 0.03 < 0.06 < value.high + 0.03, (seed, value)
    assert found.errors.augmented < found.errors.baseline
    # Named: on so short a recording as is held out, what is right may do no better.
    adopted = {each.effect: each.parameters["share"] for each in adoptable(found.summary(), 1)}
    assert adopted == {name: value.in_plant}


@pytest.mark.nightly
@pytest.mark.slow
def test_a_number_is_not_left_in_the_hollow_that_it_begins_in() -> None:
    """A recording with which a fit from what was said ended there, sure of it and wrong."""
    robot, seed = load_robot("prism3"), 1120288754
    told = Plant(robot, parameters=PlantParameters(cable_stiffness=1 / 1.06))
    windows = Windows.cut(robot, [recorded(robot, (), seed)], seconds=0.4)
    fitter = fitter_of(windows, told)
    fitter, begun = fitted_as_given(fitter, fitter.first_estimate(()), calibrated=False)
    found = calibrated(fitter, begun, unsure_terms({"cable_stiffness": 0.05}))
    ((value,),) = (term.values for term in found.terms)
    assert value > 0.025, value


@pytest.mark.slow
def test_an_effect_is_found_beside_a_wrong_number(robot: Robot, seed: int) -> None:
    hidden = (Term(EFFECTS["winch_gain"], None, (0.15,)),)
    told = Plant(robot, parameters=PlantParameters(cable_stiffness=1 / 1.05))
    logs = [recorded(robot, hidden, seed + i) for i in range(2)]
    unsure = {"cable_stiffness": 0.05}
    found = diagnose(
        told, logs[:1], logs[1:], FEW, QUICK, DiagnosisOptions(0.4, seed=seed), unsure=unsure
    )
    answer = found.answers[0]
    assert [each.effect for each in answer] == ["winch_gain"], (seed, found.verdict)
    assert answer[0].values[0].value == pytest.approx(0.15, abs=0.02), seed
    (value,) = found.calibration[0].values
    assert value.low - 0.03 < 0.05 < value.high + 0.03, (seed, value)
    assert not found.calibration[0].held_back, (seed, value)
    assert held_back(found) == ""


@pytest.mark.slow
def test_a_number_that_made_up_for_what_was_missing_is_left_behind(robot: Robot, seed: int) -> None:
    windows = Windows.cut(
        robot, [recorded(robot, (Term(EFFECTS["winch_gain"], None, (0.3,)),), seed)], seconds=0.4
    )
    fitter = fitter_of(windows, Plant(robot))
    (unsure,) = unsure_terms({"cable_stiffness": 0.05})
    (candidate,) = candidates(robot, {"winch_gain": EFFECTS["winch_gain"]})
    search = Search(fitter, (candidate,))
    misled = search.score_all(fitted(fitter, (replace(unsure, values=(1.5,)),), rounds=2))
    terms = (*misled.fit.terms, candidate.term((2.5,)))
    free = fitter.free(terms)
    begun = fitter.warm_start(misled.fit, terms, free)
    lower = search.warm_start(misled, terms)
    assert lower.cost <= begun.cost, seed
    found, led = (fitter.fit(each, free, rounds=1) for each in (lower, begun))
    # After a round the one that began lower need not be ahead; in the end it is not behind.
    ended = [search.fit_until(fit).cost for fit in (found, led)]
    assert ended[0] < 1.1 * ended[1], seed
    assert abs(found.terms[0].values[0]) < 0.2, seed  # nothing is wrong with it
    assert found.terms[1].values[0] == pytest.approx(0.3, abs=0.05), seed


def test_what_is_known_well_stays_where_it_is(robot: Robot, seed: int) -> None:
    """No recording outweighs somebody who is sure."""
    told = Plant(robot, parameters=PlantParameters(cable_stiffness=1 / 1.05))
    log = recorded(robot, (), seed)
    sure = {"cable_stiffness": 1e-6}
    found = diagnose(told, [log], (), FEW, QUICK, DiagnosisOptions(0.4, seed=seed), unsure=sure)
    assert abs(found.calibration[0].values[0].in_plant) < 1e-4, seed


@pytest.mark.slow
def test_a_number_that_would_have_to_be_further_off_than_is_believed_is_named(robot, seed):
    told = Plant(robot, parameters=PlantParameters(cable_stiffness=1 / 1.3))
    found = diagnose(
        told,
        [recorded(robot, (), seed)],
        (),
        FEW,
        QUICK,
        DiagnosisOptions(0.4),
        unsure={"cable_stiffness": 0.05},
    )
    (stiffness,) = found.calibration
    assert stiffness.held_back, (seed, stiffness)
    assert stiffness.values[0].in_plant == pytest.approx(FittingSettings().believed * 0.05)
    assert found.summary()["calibration"][0]["held_back"]
    assert "more of cable_stiffness than is allowed (3 of" in held_back(found)
    assert held_back(found) in diagnosis_page(found, {})


@pytest.mark.parametrize("deviation", [0.0, -0.1, math.inf, math.nan])
def test_a_deviation_is_a_positive_number(deviation: float) -> None:
    with pytest.raises(DataError, match="positive number"):
        unsure_terms({"body_mass": deviation})


def test_places_and_unknown_names_are_refused() -> None:
    with pytest.raises(DataError, match="weak_cable is not a single number.*cable_stiffness"):
        unsure_terms({"weak_cable": 0.1})
    with pytest.raises(UnknownNameError, match="body_mass"):
        unsure_terms({"bodymass": 0.1})
    present = (Term(CALIBRATIONS["body_mass"], None, (0.02,)),)
    with pytest.raises(DataError, match="has body_mass already"):
        unsure_terms({"body_mass": 0.1}, present)


@pytest.mark.parametrize("name", SCALES)
def test_a_calibration_is_the_plants_own_scale(robot: Robot, name: str) -> None:
    rng = np.random.default_rng(draws.seed())
    factor = float(rng.uniform(0.8, 1.25))
    scale = SCALES[name]
    term = Term(NAMED[name], None, (factor - 1.0,))
    nominal, scaled = Plant(robot), Plant(robot, parameters=PlantParameters(**{scale: factor}))
    start = nominal.settle(0.2)
    controls = np.zeros((1, 10, len(robot.winches)))
    ours = AugmentedPlant(nominal).simulate(start, controls, [(term,)])
    theirs = AugmentedPlant(scaled).simulate(start, controls, [()])
    np.testing.assert_allclose(ours.points, theirs.points, atol=1e-9)


def test_somebody_who_is_unsure_of_all_that_is_asked_about_is_told(robot: Robot, seed: int) -> None:
    asked = {"winch_gain": EFFECTS["winch_gain"]}
    with pytest.raises(DataError, match="leave at least one to test"):
        diagnose(Plant(robot), [recorded(robot, (), seed)], (), asked, unsure={"winch_gain": 0.05})


def test_a_number_moves_no_further_than_anybody_believes(robot: Robot, seed: int) -> None:
    """Cables that are a third stiffer than was said, by somebody who was sure of two percent."""
    told = Plant(robot, parameters=PlantParameters(cable_stiffness=1 / 1.3))
    fitter = fitter_of(Windows.cut(robot, [recorded(robot, (), seed)], seconds=0.4), told)
    said = unsure_terms({"cable_stiffness": 0.02})
    found = calibrated(fitter, fitted(fitter, rounds=1), said)
    ((value,),) = (term.values for term in found.terms)
    assert value == pytest.approx(0.06), seed  # three deviations, where more would fit better


@pytest.mark.slow
def test_only_the_best_beginnings_of_a_model_that_lacks_more_are_fitted_on(
    robot: Robot, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    hidden = (Term(EFFECTS["winch_gain"], None, (0.3,)),)
    windows = Windows.cut(robot, [recorded(robot, hidden, seed)], seconds=0.4)
    fitter = fitter_of(windows, Plant(robot))
    begun = fitted(fitter, rounds=1)
    said = unsure_terms({"cable_stiffness": 0.05, "body_mass": 0.05})
    rounds: list[object] = []
    fit = type(fitter).fit

    def counted(self, *arguments, **more):
        rounds.append(more.get("rounds"))
        return fit(self, *arguments, **more)

    monkeypatch.setattr(type(fitter), "fit", counted)
    calibrated(fitter, begun, said)
    assert rounds.count(1) == 5 + STARTS, (seed, rounds)
