"""The page of a diagnosis needs nothing but itself, and says what was found."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from flywheel.diagnosis import Diagnosis, Verdict, diagnose
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS
from flywheel.hidden import hidden_effect
from flywheel.hidden.recording import record
from flywheel.reports.diagnosis_page import sentence, write_diagnosis
from flywheel.robots import load_robot


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    robot = load_robot("prism3")
    hidden = hidden_effect("winch_gain").typical(robot, np.random.default_rng(0)).scaled(2.0)
    made = [record(robot, [hidden], seconds=0.8, seed=seed) for seed in (1, 2)]
    library = {name: EFFECTS[name] for name in ("winch_gain", "cable_friction")}
    trajectories = [each.trajectory for each in made]
    return diagnose(Plant(robot), trajectories[:1], trajectories[1:], library)


def test_it_needs_no_other_file_and_names_what_was_found(found: Diagnosis, tmp_path: Path) -> None:
    page = write_diagnosis(found, tmp_path / "page.html", {"robot": "prism3"}).read_text()
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


def test_the_summary_is_plain_numbers(found: Diagnosis) -> None:
    summary = found.summary()
    assert summary["verdict"] == str(found.verdict)
    assert summary["answer_set"][0][0]["effect"] == "winch_gain"
    gain = summary["answer_set"][0][0]["parameters"]["share"]
    assert gain["low"] < gain["value"] < gain["high"]
    assert gain["in_plant"] == found.answers[0][0].term.values[0]
    assert summary["unexplained"] is None and summary["stand_in"] is None
    assert summary["error"]["augmented"] < summary["error"]["baseline"]
    assert set(summary["held_out"]) == {"noise", "baseline", "augmented", "unit"}
