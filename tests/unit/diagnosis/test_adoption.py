"""What may become part of a plant, and what it is written down with.

The way from logs to a plant that explains them is gone in docs/diagnosis.md, which tests run.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from flywheel.diagnosis.adoption import adopt, adoptable
from flywheel.effects import EFFECTS, AdoptedPlant
from flywheel.effects.adopted import file_digest
from flywheel.errors import DataError, FlywheelError
from flywheel.robots import load_robot
from pipelines.cli import app

PRISM = load_robot("prism3")


def found(effect: str, **values: float) -> dict[str, Any]:
    parameters = {
        name: {"value": value, "low": 0.9 * value, "high": 1.1 * value, "unit": "-"}
        for name, value in values.items()
    }
    return {"effect": effect, "location": "", "parameters": parameters}


GAIN, FRICTION = found("winch_gain", share=0.2), found("cable_friction", force=300.0)


def answer(verdict: str, *alternatives: list[dict[str, Any]], after: float = 0.009) -> dict:
    return {
        "verdict": verdict,
        "answer_set": [list(each) for each in alternatives] or [[]],
        "held_out": {"noise": 0.009, "baseline": 0.012, "augmented": after, "unit": "m"},
        "recordings": ["monday.csv"],
        "robot": {"name": PRISM.name, "digest": PRISM.digest},
    }


def test_an_answer_becomes_a_version_with_its_evidence(tmp_path: Path) -> None:
    first = adopt(answer("EFFECT", [GAIN]), PRISM, tmp_path)
    second = adopt(answer("PARTIAL", [GAIN, FRICTION]), PRISM, tmp_path, parent=first)
    plant, robot = AdoptedPlant.read(second)
    assert (plant.version, plant.parent) == (2, file_digest(first))
    assert [t.named for t in plant.terms(robot, EFFECTS)] == [{"share": 0.2}, {"force": 300.0}]
    assert plant.evidence["verdict"] == "PARTIAL"
    assert plant.evidence["recordings"] == ["monday.csv"]
    assert plant.evidence["intervals"][0]["share"] == pytest.approx([0.18, 0.22, "-"])


def test_the_plant_gets_the_value_that_fits_its_own_time_step(tmp_path: Path) -> None:
    gain = found("winch_gain", share=0.2)
    gain["parameters"]["share"]["in_plant"] = 0.23
    plant, robot = AdoptedPlant.read(adopt(answer("EFFECT", [gain]), PRISM, tmp_path))
    assert [t.named for t in plant.terms(robot, EFFECTS)] == [{"share": 0.23}]


@pytest.mark.parametrize(
    ("summary", "number", "message"),
    [
        (answer("NOISE_ONLY"), None, "verdict is NOISE_ONLY: there is no effect to adopt"),
        (answer("NOISE_ONLY"), 1, "there is no effect to adopt"),
        (answer("AMBIGUOUS", [GAIN], [FRICTION]), None, "1: winch_gain; 2: cable_friction"),
        (answer("OUTSIDE_LIBRARY", [GAIN]), None, "say which answer"),
        (answer("EFFECT", [GAIN]), 2, "answers 1 to 1, got 2"),
        (answer("EFFECT", [GAIN], after=0.013), None, "13 mm with these effects and 12 mm without"),
        (answer("EFFECT", [GAIN], after=float("nan")), None, "do not carry over"),
        (answer("EFFECT", [found("winch_gain", shar=0.2)]), None, "Did you mean 'share'"),
    ],
)
def test_what_is_not_clear_is_not_adopted(
    summary: dict[str, Any], number: int | None, message: str, tmp_path: Path
) -> None:
    with pytest.raises(FlywheelError, match=message):
        adopt(summary, PRISM, tmp_path / "plants", number)
    assert not (tmp_path / "plants").exists()


def test_naming_an_answer_overrules_doubts() -> None:
    ambiguous = answer("AMBIGUOUS", [GAIN], [FRICTION])
    assert [e.effect for e in adoptable(ambiguous, 2)] == ["cable_friction"]
    assert [e.effect for e in adoptable(answer("EFFECT", [GAIN], after=0.013), 1)] == ["winch_gain"]
    with pytest.raises(DataError):
        adoptable(ambiguous)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (json.dumps(answer("NOISE_ONLY")), "NOISE_ONLY: there is no effect to adopt"),
        (json.dumps({"answer_set": [], "robot": {"name": "mine", "digest": "abc"}}), "(abc), not prism3"),
        (json.dumps([1]), "it has no answer_set"),
        ("{", "is not JSON"),
    ],
)  # fmt: skip
def test_the_command_refuses_other_files(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "answer.json"
    file.write_text(text)
    arguments = ["adopt", str(file), "--robot", "prism3", "--out", str(tmp_path / "plants")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code != 0
    assert message in " ".join(result.output.split())
    assert not (tmp_path / "plants").exists()


def test_the_command_writes_what_a_diagnosis_can_be_asked_about(tmp_path: Path) -> None:
    file = tmp_path / "answer.json"
    file.write_text(json.dumps(answer("EFFECT", [GAIN])))
    arguments = ["adopt", str(file), "--robot", "prism3", "--out", str(tmp_path / "plants")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert AdoptedPlant.read(tmp_path / "plants" / "prism3-1")[0].effects[0].effect == "winch_gain"
    second = [*arguments[:3], str(tmp_path / "plants" / "prism3-1"), *arguments[4:]]
    assert CliRunner().invoke(app, second).exit_code == 0
    assert AdoptedPlant.read(tmp_path / "plants" / "prism3-2")[0].parent
