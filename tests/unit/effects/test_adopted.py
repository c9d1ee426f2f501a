"""Effects written down, and plants that have them."""

import math
import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from flywheel.effects import EFFECTS, AdoptedPlant, Scales, Term, WrittenTerm
from flywheel.effects.adopted import MJCF, PLANT, next_version
from flywheel.errors import ConfigError, FlywheelError, RobotError
from flywheel.robots import load_robot
from flywheel.seals import file_sha256
from tests import draws

PRISM = load_robot("prism3")
FRICTION = WrittenTerm(effect="cable_friction", parameters={"force": 3.0})


def some_term(name: str, rng: np.random.Generator) -> Term:
    effect, scales = EFFECTS[name], Scales.of(PRISM)
    place = effect.places(PRISM)[int(rng.integers(len(effect.places(PRISM))))]
    return Term(effect, place, tuple(rng.random() * p.typical(scales) for p in effect.parameters))


def adopted(version: int = 1, **changes: object) -> AdoptedPlant:
    plant = AdoptedPlant(
        robot=PRISM.name, digest=PRISM.digest, version=version, effects=(FRICTION,)
    )
    return plant.model_copy(update=changes)


@pytest.mark.parametrize("name", EFFECTS)
def test_what_is_written_is_read_again(name: str) -> None:
    term = some_term(name, np.random.default_rng(seed := draws.seed()))
    text = yaml.safe_dump(WrittenTerm.of(term, PRISM).model_dump())
    assert WrittenTerm.model_validate(yaml.safe_load(text)).term(PRISM, EFFECTS) == term, seed


@pytest.mark.parametrize(
    ("effect", "location", "parameters", "message"),
    [
        ("cable_fricton", "", {"force": 1.0}, "no effect 'cable_fricton'.*'cable_friction'"),
        ("ground_friction", "long_03", {"force": 1.0}, "of the whole robot"),
        ("weak_cable", "", {"share": 0.1}, "no place of weak_cable on prism3"),
        ("cable_friction", "", {"fource": 1.0}, "no parameter of cable_friction 'fource'.*'force'"),
        ("cable_friction", "", {}, "also needs force"),
        ("cable_friction", "", {"force": -1.0}, r"cannot be negative \[N\], got -1"),
    ],
)
def test_what_cannot_be_is_said(effect, location, parameters, message):
    written = WrittenTerm(effect=effect, location=location, parameters=parameters)
    with pytest.raises(FlywheelError, match=message):
        written.term(PRISM, EFFECTS)


def test_versions_are_numbered_and_never_written_over(tmp_path: Path) -> None:
    assert next_version(tmp_path / "plants", PRISM) == 1
    first = adopted().write(tmp_path / "plants", PRISM)
    assert first == tmp_path / "plants" / "prism3-1" / PLANT
    assert next_version(tmp_path / "plants", PRISM) == 2
    with pytest.raises(ConfigError, match="never overwritten"):
        adopted().write(tmp_path / "plants", PRISM)
    second = adopted(2, parent=file_sha256(first, "plant")).write(tmp_path / "plants", PRISM)
    plant, robot = AdoptedPlant.read(second.parent)
    assert (plant.version, plant.parent) == (2, file_sha256(first, "plant"))
    assert robot.digest == PRISM.digest
    assert plant.terms(robot, EFFECTS) == (FRICTION.term(PRISM, EFFECTS),)
    assert sorted(p.name for p in (tmp_path / "plants").iterdir()) == ["prism3-1", "prism3-2"]


def test_whatever_has_the_name_of_a_version_is_counted(tmp_path: Path) -> None:
    (tmp_path / "prism3-1").mkdir()
    (tmp_path / "prism3-2").symlink_to(tmp_path / "nowhere")
    assert next_version(tmp_path, PRISM) == 3


def test_a_plant_of_another_robot_is_refused(tmp_path: Path) -> None:
    path = adopted().write(tmp_path, PRISM)
    (path.parent / MJCF).write_text(load_robot("icosa6").xml)
    with pytest.raises(RobotError, match="sizes are meaningless on another robot"):
        AdoptedPlant.read(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot: [", "is not YAML"),
        ("just words", "not an adopted plant"),
        ("{robot: a, digest: b, version: 1, effects: []}", "effects: Tuple should have at least 1"),
        (
            "{robot: a, digest: b, version: 1, efects: []}",
            "efects: unknown key. Did you mean 'effects'",
        ),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / PLANT
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        AdoptedPlant.read(path)


def test_a_missing_one_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no adopted plant .*nowhere.yaml"):
        AdoptedPlant.read(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize("field", ["robot", "digest", "version", "parent", "effects", "evidence"])
def test_a_field_of_another_type_is_refused_by_its_name(tmp_path: Path, field: str) -> None:
    path = adopted().write(tmp_path, PRISM)
    good = yaml.safe_load(path.read_text())
    others = (None, True, -3, 0.5, "x", [], [1], {}, {1: 2}, math.nan, math.inf, 10**40)
    for other in others:
        path.write_text(yaml.safe_dump({**good, field: other}))
        try:
            AdoptedPlant.read(path)
        except FlywheelError as error:
            assert field in str(error) or "digest" in str(error)
            assert len(str(error)) < 1000


def test_values_of_effects_are_numbers_within_bounds_however_they_are_written(tmp_path):
    path = adopted().write(tmp_path, PRISM)
    text = path.read_text()
    path.write_text(text.replace("force: 3.0", "force: 1e-3"))
    assert AdoptedPlant.read(path)[0].effects[0].parameters == {"force": 1e-3}
    for wrong in (".nan", ".inf", "1e300", "true", "'3'", "null", "[3]", "!!float x"):
        path.write_text(text.replace("force: 3.0", f"force: {wrong}"))
        with pytest.raises(ConfigError, match="force: must be a number|an invalid value"):
            AdoptedPlant.read(path)


def test_what_is_no_file_of_a_plant_is_refused_at_once(tmp_path: Path) -> None:
    path = adopted().write(tmp_path, PRISM)
    for text in ("a: &a [1]\n" * 3 + "b: [" + "x, " * 2_000_000 + "]", "\xff", "[" * 100):
        path.write_text(text, encoding="latin-1")
        with pytest.raises(ConfigError):
            AdoptedPlant.read(path)
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(ConfigError, match="is a pipe"):
        AdoptedPlant.read(path.parent)
    for name in ("x" * 5000, "a\0b", "/dev/zero"):
        with pytest.raises(ConfigError):
            AdoptedPlant.read(name)


def test_names_that_yaml_would_take_for_numbers_come_back_as_names(tmp_path: Path) -> None:
    friction = FRICTION.model_copy(update={"location": "1e3"})
    path = adopted(robot="1e3", effects=(friction,)).write(tmp_path, PRISM)
    plant, _ = AdoptedPlant.read(path)
    assert (plant.robot, plant.effects[0].location) == ("1e3", "1e3")
