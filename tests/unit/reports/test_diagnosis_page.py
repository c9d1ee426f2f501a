"""The page of a diagnosis needs nothing but itself, and says what was found."""

import dataclasses
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flywheel.diagnosis import Diagnosis, Settings, Verdict, changed, diagnose
from flywheel.diagnosis.selection.misspecification import Misspecification
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, PROBES
from flywheel.reports.diagnosis_page import (
    at_bounds,
    diagnosis_page,
    gains,
    held_back,
    other_form,
    sentence,
    write_diagnosis,
)
from flywheel.robots import load_robot
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.recording import record

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    robot = load_robot("platform4")
    hidden = hidden_effect("winch_gain").typical(robot, np.random.default_rng(0)).scaled(2.0)
    made = [record(robot, [hidden], seconds=0.8, seed=seed) for seed in (1, 2)]
    library = {name: EFFECTS[name] for name in ("winch_gain", "cable_friction")}
    trajectories = [each.trajectory for each in made]
    return diagnose(Plant(robot), trajectories[:1], trajectories[1:], library)


def test_it_needs_no_other_file_and_names_what_was_found(found: Diagnosis, tmp_path: Path) -> None:
    page = write_diagnosis(found, tmp_path / "page.html", {"robot": "platform4"}).read_text()
    assert "winch_gain" in page
    assert "flywheel design winch_gain cable_friction" in page
    assert str(found.verdict) in page
    linked = re.findall(r'(?:src|href)="(?!data:)([^"]*)"', page)
    assert linked == []
    assert page.count('src="data:image/svg+xml') == 6


@pytest.mark.parametrize("verdict", Verdict)
def test_every_verdict_has_a_sentence(found: Diagnosis, verdict: Verdict) -> None:
    other = dataclasses.replace(found, verdict=verdict)
    assert sentence(other).endswith(".")
    assert other.next_experiment.aim.endswith(".")


def test_it_says_what_was_believed_and_decided_with_the_settings_it_was_made_with(found):
    assert "settings" not in found.summary()
    changes = {"fitting.believed": 2.0, "limits.equally_good": 60.0}
    (effect,) = found.answers[0]
    law = Misspecification(next(iter(PROBES)), 100.0, 0.5, next(iter(PROBES)), gain=50.0)
    calibration = (replace(effect, held_back=True),)
    usual = replace(found, calibration=calibration, misspecification=law, other_form=True)
    other = replace(usual, settings=changed(Settings(), changes))
    assert other.summary()["settings"] == changes
    assert "than is allowed (3 of" in held_back(usual)
    assert "than is allowed (2 of" in held_back(other)
    assert other_form(usual) != other_form(other)


def test_it_says_where_a_bound_stopped_a_fit(found: Diagnosis) -> None:
    assert at_bounds(found) == ""
    (effect,) = found.answers[0]
    stopped = replace(found, answers=((replace(effect, at_bound=effect.values),),))
    (value,) = effect.values
    told = f"share of winch_gain is at its bound, {value.in_plant:.4g} (its interval reaches to "
    assert at_bounds(stopped).startswith(told)
    assert at_bounds(stopped) in diagnosis_page(stopped, {})


def test_the_summary_is_plain_numbers(found: Diagnosis) -> None:
    summary = found.summary()
    assert summary["verdict"] == str(found.verdict)
    assert summary["answer_set"][0][0]["effect"] == "winch_gain"
    gain = summary["answer_set"][0][0]["parameters"]["share"]
    assert gain["low"] < gain["value"] < gain["high"]
    assert gain["in_plant"] == found.answers[0][0].term.values[0]
    assert summary["unexplained"] is None and summary["discrepancy_model"] is None
    assert summary["error"]["augmented"] < summary["error"]["baseline"]
    assert set(summary["held_out"]) == {"noise", "baseline", "augmented", "unit"}


def test_another_form_is_said_where_nothing_else_is_left(found: Diagnosis, tmp_path: Path) -> None:
    law = Misspecification("gain_by_rate", 3.0, 0.01, instead="damping_by_speed_squared", gain=77.0)
    other = replace(found, verdict=Verdict.OUTSIDE_LIBRARY, misspecification=law, other_form=True)
    page = write_diagnosis(other, tmp_path / "page.html", {}).read_text()
    assert "The unexplained error" in page
    assert "damping_by_speed_squared, which is outside the library, explains more" in page
    assert "Most of it is in recording" not in page
    assert PROBES["damping_by_speed_squared"].shown_by in page
    beside = replace(other, misspecification=replace(law, gain=4.0, share=0.3))
    page = write_diagnosis(beside, tmp_path / "page.html", {}).read_text()
    scored = "gain_by_rate, which is outside the library, scores 3"
    assert f"{scored} in addition to the answer, 30% of the explanation by both" in page
    alone = other_form(replace(beside, answers=((),)))
    assert alone == scored


def test_it_says_what_the_answer_is_worth_where_it_was_not_fitted(found: Diagnosis) -> None:
    """Two recordings, one held out; nothing else is missing, so that all of the error is gone."""
    assert found.gain is not None
    assert found.gain.clear
    assert found.gain.share > 0.9
    assert found.gain.held_out > 0
    words = gains(found)
    assert f"{found.gain.share:.0%}" in words
    assert words in diagnosis_page(found, {})
    (effect,) = found.answers[0]
    assert effect.gain is not None
    assert effect.gain.clear
    summary = found.summary()
    assert summary["held_out_gain"]["share"] == found.gain.share
    assert summary["answer_set"][0][0]["held_out_gain"]["windows"] == effect.gain.windows
    assert gains(replace(found, gain=None)) == ""


def test_what_is_tolerated_is_not_looked_for(found: Diagnosis) -> None:
    """The same recordings, were the error that they show of no interest."""
    robot = load_robot("platform4")
    hidden = hidden_effect("winch_gain").typical(robot, np.random.default_rng(0)).scaled(2.0)
    log = record(robot, [hidden], seconds=0.8, seed=1).trajectory
    library = {"winch_gain": EFFECTS["winch_gain"]}
    off = found.before.beyond_noise
    said = {}
    for share in (1.5, 0.5):
        tuned = changed(Settings(), {"limits.tolerance": share * off})
        said[share] = diagnose(Plant(robot), [log], (), library, tuned)
    assert said[1.5].verdict is Verdict.NOISE_ONLY
    assert not any(said[1.5].answers)
    assert "within the tolerance" in sentence(said[1.5])
    assert said[0.5].verdict is Verdict.EFFECT
