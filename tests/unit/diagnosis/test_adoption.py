"""What may become part of a plant, and what it is written down with.

The way from logs to a plant that explains them is gone in docs/diagnosis.md, which tests run.
"""

import copy
import json
import math
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.diagnosis.adoption import adopt, adoptable
from flywheel.diagnosis.results.answer import FORMAT, Answer
from flywheel.effects import EFFECTS, NAMED, AdoptedPlant
from flywheel.errors import DataError, FlywheelError
from flywheel.files import parsed_yaml
from flywheel.robots import load_robot, read_robot
from flywheel.seals import file_sha256

PRISM = load_robot("prism3")


def found(effect: str, **values: float) -> dict[str, Any]:
    units = {parameter.name: parameter.unit for parameter in NAMED[effect].parameters}
    parameters = {
        name: {
            "value": value,
            "low": 0.9 * value,
            "high": 1.1 * value,
            "unit": units.get(name, "-"),
        }
        for name, value in values.items()
    }
    return {"effect": effect, "location": "", "parameters": parameters}


GAIN, FRICTION = found("winch_gain", share=0.2), found("cable_friction", force=300.0)


def answer(verdict: str, *alternatives: list[dict[str, Any]], after: float = 0.009) -> dict:
    return {
        "format": FORMAT,
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
    assert (plant.version, plant.parent) == (2, file_sha256(first, "plant"))
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
        (
            answer("OUTSIDE_LIBRARY", [GAIN], after=0.0111),
            None,
            "choose the answer.* 33% of .* from 50%",
        ),
        (answer("OUTSIDE_LIBRARY", [GAIN], [FRICTION]), None, "choose the answer"),
        (answer("PARTIAL", [GAIN], [FRICTION]), None, "1: winch_gain; 2: cable_friction"),
        (
            {
                **answer("PARTIAL", [GAIN]),
                "suspect_parameters": [{"name": "cable_stiffness", "explained": 0.99}],
            },
            None,
            "Another cable_stiffness in the MJCF explains more than any effect",
        ),
        (
            {**answer("OUTSIDE_LIBRARY", [GAIN]), "held_out": None},
            None,
            "Held-out recordings would",
        ),
        (answer("EFFECT", [GAIN]), 2, "answers 1 to 1, got 2"),
        (answer("EFFECT", [GAIN], after=0.013), None, "13 mm with these effects and 12 mm without"),
        (answer("EFFECT", [GAIN], after=float("nan")), None, "do not carry over"),
        (answer("EFFECT", [found("winch_gain", shar=0.2)]), None, "Did you mean 'share'"),
    ],
)
def test_what_is_not_clear_is_not_adopted(summary, number, message, tmp_path):
    with pytest.raises(FlywheelError, match=message):
        adopt(summary, PRISM, tmp_path / "plants", number)
    assert not (tmp_path / "plants").exists()


def test_an_effect_that_explains_most_of_what_is_held_out_is_adopted_beside_what_nobody_explains():
    assert [e.effect for e in adoptable(answer("OUTSIDE_LIBRARY", [GAIN], after=0.0105))] == [
        "winch_gain"
    ]


@pytest.mark.parametrize(("share", "clear"), [(0.3, True), (0.4, False)])
def test_the_share_from_which_that_is_so_is_a_setting(share: float, clear: bool) -> None:
    third = answer("OUTSIDE_LIBRARY", [GAIN], after=0.0111)
    assert Answer.of({**third, "settings": {"limits.most": share}}).is_clear == clear


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
        (json.dumps({**answer("EFFECT"), "robot": {"name": "mine", "digest": "abc"}}), "(abc), not prism3"),
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


WHOLE = {
    "format": FORMAT,
    "verdict": "EFFECT",
    "model": "plant",
    "answer_set": [[GAIN, {**FRICTION, "note": "of a newer version"}]],
    "calibration": [{**found("cable_stiffness", share=0.02), "held_back": False}],
    "suspect_parameters": [],
    "ranking": [{"effect": "winch_gain", "location": "", "score": 12.0, "sizes": {}}],
    "threshold": 25.0,
    "error": {"noise": 0.009, "baseline": 0.012, "augmented": 0.009, "unit": "m"},
    "held_out": {"noise": 0.009, "baseline": 0.012, "augmented": 0.009, "unit": "m"},
    "residual": {"noise": 0.009, "correlation": 0.1, "inconstancy": 0, "loudest": 1.5},
    "misspecification": None,
    "next_experiment": {"aim": "none", "command": ""},
    "time_steps": {"own": 0.005, "taken": [0.005], "unit": "s"},
    "seconds": 12.0,
    "robot": {"name": PRISM.name, "digest": PRISM.digest},
    "recordings": ["monday.csv"],
    "held_out_recordings": ["friday.csv"],
}
OTHERS = (
    None,
    True,
    -3,
    0,
    0.5,
    "x",
    "",
    [],
    [1],
    {},
    {"a": 1},
    math.nan,
    math.inf,
    1e300,
    10**400,
)
GONE = object()


def fields(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of everything within a value."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        yield (*path, key)
        if isinstance(inner, dict | list):
            yield from fields(inner, (*path, key))


def changed(path: tuple[Any, ...], to: object) -> dict[str, Any]:
    """The whole answer with one field changed, or left out."""
    answer: Any = copy.deepcopy(WHOLE)
    inner = answer
    for key in path[:-1]:
        inner = inner[key]
    if to is GONE:
        del inner[path[-1]]
    else:
        inner[path[-1]] = to
    return answer


def test_a_whole_answer_is_adopted_and_what_newer_versions_add_is_left_out(tmp_path: Path) -> None:
    plant, _ = AdoptedPlant.read(adopt(WHOLE, PRISM, tmp_path))
    assert [each.effect for each in plant.effects] == [
        "winch_gain",
        "cable_friction",
        "cable_stiffness",
    ]
    assert plant.evidence["residual"]["loudest"] == 1.5
    assert plant.evidence["held_out_recordings"] == ["friday.csv"]
    assert "note" not in plant.evidence["intervals"][1]


@pytest.mark.parametrize("path", list(fields(WHOLE)), ids=lambda path: ".".join(map(str, path)))
def test_a_field_of_another_type_is_refused_in_a_sentence_or_not_needed(path, tmp_path):
    for to in (*OTHERS, GONE):
        try:
            made = adopt(changed(path, to), PRISM, tmp_path)
        except FlywheelError as error:
            assert len(str(error)) < 2000
        else:
            assert AdoptedPlant.model_validate(parsed_yaml(made.read_text(), "It", DataError))


@pytest.mark.parametrize(
    ("path", "to", "message"),
    [
        (("format",), FORMAT + 1, f"has format {FORMAT + 1}; this version reads {FORMAT}"),
        (("format",), FORMAT - 1, f"has format {FORMAT - 1}; this version reads {FORMAT}"),
        (("format",), GONE, "format: is required"),
        (("format",), True, "format: must be a whole number"),
        (("verdict",), [1], "verdict: .*got \\[1\\]"),
        (("verdict",), GONE, "verdict: is required"),
        (("answer_set", 0, 0), 3, r"answer_set.0.0: .*got 3"),
        (("answer_set", 0, 0, "effect"), None, r"answer_set.0.0.effect: .*got None"),
        (("answer_set", 0, 0, "parameters"), GONE, r"answer_set.0.0.parameters: is required"),
        (("answer_set", 0, 0, "parameters", "share", "value"), True, "share.value: must be a number .*True"),
        (("answer_set", 0, 0, "parameters", "share", "value"), math.inf, "share.value: must be a number"),
        (("answer_set", 0, 0, "parameters", "share", "value"), 0.25, "within .* 0.18 to 0.22; got 0.25"),
        (("answer_set", 0, 0, "parameters", "share", "low"), 0.21, "within .* 0.21 to 0.22; got 0.2"),
        (("answer_set", 0, 0, "parameters", "share", "unit"), "%", "is in '-'; the answer has it in '%'"),
        (("answer_set", 0, 0, "parameters", "share", "in_plant"), 1e9, "must be .*; got 1000000000.0"),
        (("answer_set", 0, 1), GAIN, "has winch_gain twice"),
        (("calibration", 0), GAIN, "has winch_gain twice"),
        (("answer_set", 0, 0, "parameters", "share", "low"), "x", "share.low: .*valid number; got 'x'"),
        (("held_out", "augmented"), "x", "held_out.augmented: .*got 'x'"),
        (("recordings",), ["x" * 199] * 5000, "evidence .* has 1,0.* characters .* at most 200,000"),
        (("robot",), [], r"robot: must be a mapping; got \[\]"),
    ],
)  # fmt: skip
def test_the_message_names_the_field(path, to, message, tmp_path):
    with pytest.raises(DataError, match=message):
        adopt(changed(path, to), PRISM, tmp_path / "plants")
    assert not (tmp_path / "plants").exists()


def test_a_misspelt_verdict_is_told_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(FlywheelError, match="no verdict 'EFECT'.*Did you mean 'EFFECT'"):
        adopt({**WHOLE, "verdict": "EFECT"}, PRISM, tmp_path, 1)


@pytest.mark.parametrize(
    ("had", "robot", "message"),
    [
        ([], "prism3-1", "about a plant with no effect; {}/prism3-1 has winch_gain"),
        (["winch_gain"], "prism3", "about a plant with winch_gain; prism3 has no effect"),
        (["winch_gain"], "prism3-1", ""),
        ([], "prism3", ""),
    ],
)
def test_an_answer_about_another_plant_would_lose_effects(had, robot, message, tmp_path):
    adopt(answer("EFFECT", [GAIN]), PRISM, tmp_path)
    file = tmp_path / "answer.json"
    about = {"name": PRISM.name, "digest": PRISM.digest, "effects": had}
    file.write_text(json.dumps({**answer("EFFECT", [FRICTION]), "robot": about}))
    named = robot if robot == "prism3" else str(tmp_path / robot)
    result = CliRunner().invoke(app, ["adopt", str(file), "--robot", named, "--out", str(tmp_path)])
    assert result.exit_code == (2 if message else 0), result.output
    assert message.format(tmp_path) in " ".join(result.output.split())


def test_commands_that_come_next_can_be_pasted(tmp_path: Path) -> None:
    file = tmp_path / "answer.json"
    file.write_text(json.dumps(answer("EFFECT", [GAIN])))
    out = tmp_path / "my plants"
    result = CliRunner().invoke(app, ["adopt", str(file), "--robot", "prism3", "--out", str(out)])
    words = shlex.split(result.output.replace("(", "").replace(".\n", "\n"))
    assert str(out / "prism3-1") in words and f"effects={out}/prism3-1/plant.yaml:" in words


@pytest.mark.parametrize(
    "robot", [None, [], "x", {"digest": None}, {"digest": 3}, {"name": []}, {}]
)
def test_the_command_refuses_answers_about_nobody_it_knows(robot: object, tmp_path: Path) -> None:
    file = tmp_path / "answer.json"
    file.write_text(json.dumps({**WHOLE, "robot": robot}))
    result = CliRunner().invoke(
        app, ["adopt", str(file), "--robot", "prism3", "--out", str(tmp_path)]
    )
    assert (result.exit_code, type(result.exception)) == (2, SystemExit), result.output
    assert "robot" in result.output


@pytest.mark.parametrize(
    "name", ["../ESCAPED", "/etc", "a/b", "..", "[red]x", "1e3", "a*", "\u202egnp"]
)
def test_no_name_of_a_robot_leads_out_of_the_folder(name: str, tmp_path: Path) -> None:
    xml = PRISM.xml.replace('model="prism3"', f'model="{name}"')
    robot = read_robot(xml)
    assert robot.name == name
    about = {**WHOLE, "robot": {"name": name, "digest": robot.digest}}
    folder = tmp_path / "a" / "plants"
    first, second = (adopt(about, robot, folder) for _ in range(2))
    assert {first.parent.parent, second.parent.parent} == {folder}
    assert [AdoptedPlant.read(path)[0].version for path in (first, second)] == [1, 2]
    assert AdoptedPlant.read(first)[0].robot == name
    assert sorted(tmp_path.rglob("plant.yaml")) == sorted([first, second])


@pytest.mark.parametrize("out", ["file/below", "/proc/none"])
def test_a_folder_that_cannot_be_made_is_told(out: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FlywheelError, match="cannot be written"):
        adopt(WHOLE, PRISM, tmp_path / out)


def test_evidence_that_could_not_be_read_again_is_not_written(tmp_path: Path) -> None:
    deep: Any = "x"
    for _ in range(59):
        deep = [deep]
    with pytest.raises(FlywheelError, match="more than 60 brackets within brackets"):
        adopt({**WHOLE, "residual": deep}, PRISM, tmp_path)
    assert list(tmp_path.iterdir()) == []
