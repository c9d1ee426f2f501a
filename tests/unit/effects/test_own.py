"""Law files: what is read, what is refused, and how effects of them get to other processes."""

import copy
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flywheel.diagnosis.checks.discrepancy import LearnedTension
from flywheel.effects import EFFECTS, NAMED, PROBES, AdoptedPlant, Term, Winches, WrittenTerm
from flywheel.effects.declaration import wrong_in_declaration
from flywheel.effects.libraries import RESERVED, with_laws
from flywheel.effects.own import LawFile, LawReference, law_file, law_files
from flywheel.errors import ConfigError
from flywheel.robots import load_robot
from flywheel.seals import file_sha256
from tests import own_laws

PRISM = load_robot("prism3")
NAMED_COGGING = WrittenTerm(
    effect="cogging", parameters={"sine": 0.4, "cosine": 0.0, "pitch": 0.15}
)


def changed(old: str, new: str) -> str:
    assert old in own_laws.FRICTION
    return own_laws.FRICTION.replace(old, new)


def test_a_law_file_adds_its_effects_after_those_of_the_library(tmp_path: Path) -> None:
    path = own_laws.law_file(tmp_path)
    file = LawFile.read(path)
    library = with_laws([file], EFFECTS)
    assert list(library) == [*EFFECTS, "cogging"]
    assert file.reference == LawReference(file="my_laws.py", sha256=file_sha256(path, "law file"))
    assert law_files(library.values()) == (file,)
    assert law_file(library["capstan"]) is None
    assert "text" not in file.model_dump() and "import" not in repr(file)


def test_a_cogging_winch_follows_its_formula(tmp_path: Path) -> None:
    effect = with_laws([LawFile.read(own_laws.law_file(tmp_path))])["cogging"]
    rng = np.random.default_rng(0)
    rate, position = rng.uniform(-1, 1, (4, 3)), rng.uniform(0.5, 2, (4, 3))
    values = {
        name: np.full((4, 3), v) for name, v in (("sine", 0.4), ("cosine", 0.1), ("pitch", 0.15))
    }
    got = effect.rate(rate, Winches(position, np.zeros((4, 3))), values)  # type: ignore[attr-defined]
    turn = 2 * np.pi * position / 0.15
    assert got == pytest.approx(rate * (1 + 0.4 * np.sin(turn) + 0.1 * np.cos(turn)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def (:\n", r"my_laws\.py is not Python: invalid syntax in line 1"),
        (
            "x = 1\n\ny = x / 0\n",
            "raises ZeroDivisionError in line 3 on import: division",
        ),
        ("import nothing_like_it\n", "raises ModuleNotFoundError in line 1 .*nothing_like_it"),
        ("raise SystemExit(0)\n", "raises SystemExit in line 1 on import: 0"),
        ("x = 1\n", "my_laws.py defines no effect: a class of ModelEffect"),
        ("from flywheel.effects import TensionEffect\n", "defines no effect"),
        (changed('"rub"', '"capstan"'), "defines an effect 'capstan', a name that is taken"),
        (
            changed('"rub"', '"gain_by_rate"'),
            "defines an effect 'gain_by_rate', a name that is taken",
        ),
        (
            changed('"rub"', '"my rub"'),
            "law Rub of my_laws.py has the name 'my rub': a name consists of",
        ),
        (changed('"rub"', "7"), "has the name 7: a name consists of letters"),
        (changed('    name = "rub"\n', ""), "law Rub of my_laws.py has no `name`"),
        (
            changed("def tension", "def tensions"),
            "has no method `tension`, which a TensionEffect needs",
        ),
        (
            changed("sizes = (", "sizes = ").replace("weight),)", "weight)"),
            "not a tuple of Parameter",
        ),
        (changed("sizes = (", "shapes = ("), "has no sizes"),
        (changed('"N", ', '"", '), "a parameter 'force' without a unit"),
        (changed("weight)", "weight, high=None)"), "'force' without bounds: low 0.0 and high None"),
        (
            changed("weight)", 'weight, high=float("inf"))'),
            "without bounds: .* high inf must be finite",
        ),
        (changed("weight)", 'weight, low="0")'), "without bounds: low '0'"),
        (changed("weight)", "weight, low=2, high=1)"), "whose low, 2, is not below its high, 1"),
        (
            changed("weight)", "weight, low=1)"),
            "from 1 to 20 typical sizes: its bounds must include 0",
        ),
        (changed("0.01 * s.weight", "-s.weight"), "whose typical value is -9.8.*, not a positive"),
        (changed("0.01 * s.weight", "s.wait"), "whose typical value raises AttributeError"),
        (changed("lambda s: 0.01 * s.weight", "1.0"), "whose typical value raises TypeError"),
        (changed('    source = "made up"\n', ""), "does not declare its `source`"),
        (changed('"made up"', "1968"), "does not declare its `source` as text"),
        (
            changed('name = "rub"', 'name, where = "rub", "point"'),
            "a TensionEffect is at 'robot' or 'cable'",
        ),
        (
            changed(
                "    equation", '    shapes = (Parameter("d", "m", lambda s: 1.0),)\n    equation'
            ),
            r"a shape d whose grid is \(\)",
        ),
        (own_laws.FRICTION + "\nclass Again(Rub):\n    pass\n", "two effects of the name 'rub'"),
        (
            changed('    """Rubs."""', "    def __init__(self, x):\n        pass"),
            "made without arguments",
        ),
    ],
)
def test_a_law_file_that_cannot_be_used_is_refused_in_a_sentence(tmp_path, text, message):
    file = LawFile.read(own_laws.law_file(tmp_path, text))
    with pytest.raises(ConfigError, match=message) as caught:
        with_laws([file])
    assert "\n" not in str(caught.value)


def test_what_is_no_law_file_is_refused_before_it_is_run(tmp_path: Path) -> None:
    for path, message in (
        (tmp_path / "nowhere.py", "There is no law file .*nowhere.py"),
        (tmp_path, r"ends in \.py, got"),
        (own_laws.law_file(tmp_path, name="laws.txt"), r"ends in \.py, got .*laws.txt"),
    ):
        with pytest.raises(ConfigError, match=message):
            LawFile.read(path)
    (tmp_path / "bytes.py").write_bytes(b"x = '\xff'\n")
    with pytest.raises(ConfigError, match="not text in UTF-8"):
        LawFile.read(tmp_path / "bytes.py")


def test_two_files_do_not_share_a_name_of_an_effect(tmp_path: Path) -> None:
    paths = [own_laws.law_file(tmp_path, own_laws.FRICTION + f"# {n}", f"{n}.py") for n in "ab"]
    with pytest.raises(ConfigError, match="Both a.py and b.py define an effect 'rub'"):
        with_laws([LawFile.read(path) for path in paths])


def test_a_base_class_that_laws_share_is_no_law(tmp_path: Path) -> None:
    text = own_laws.FRICTION.replace("class Rub(TensionEffect):", "class Rub(Base):").replace(
        "\nclass Rub", "\nclass Base(TensionEffect):\n    source = 'mine'\n\nclass Rub"
    )
    assert list(LawFile.read(own_laws.law_file(tmp_path, text)).effects()) == ["rub"]


def test_what_a_law_raises_later_is_one_sentence_with_its_line(tmp_path: Path) -> None:
    text = changed('values["force"]', 'values["fource"]')
    effect = LawFile.read(own_laws.law_file(tmp_path, text)).effects()["rub"]
    with pytest.raises(
        ConfigError, match="^rub of my_laws.py raises KeyError in line 14: 'fource'.$"
    ):
        effect.tension(None, None, {})  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", NAMED)
def test_effects_of_the_package_say_what_laws_have_to_say(name: str) -> None:
    assert wrong_in_declaration(type(NAMED[name])) == ""


def test_names_of_laws_that_ask_questions_are_reserved() -> None:
    assert {*PROBES, LearnedTension.name} == RESERVED


READ = """
import pickle, sys
from flywheel.effects.own import law_file
term = pickle.loads(sys.stdin.buffer.read())
print(term.effect.name, law_file(term.effect).sha256, type(term.effect).__doc__[:7])
"""


@pytest.mark.slow
def test_an_effect_gets_to_a_process_that_has_not_seen_its_file(tmp_path: Path) -> None:
    path = own_laws.law_file(tmp_path)
    file = LawFile.read(path)
    term = NAMED_COGGING.term(PRISM, with_laws([file]))
    path.unlink()
    assert pickle.loads(pickle.dumps(term)) == term
    assert copy.deepcopy(term) == term
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", READ],
        input=pickle.dumps(term),
        capture_output=True,
        env=environment,
        cwd=tmp_path,
        check=True,
    )
    assert done.stdout.decode().split() == ["cogging", file.sha256, "Winches"]


def adopted(folder: Path, file: LawFile) -> tuple[AdoptedPlant, Path]:
    plant = AdoptedPlant(
        robot=PRISM.name,
        digest=PRISM.digest,
        version=1,
        effects=(NAMED_COGGING,),
        effects_from=(file.reference,),
    )
    return plant, plant.write(folder, PRISM, [file])


def test_a_plant_is_used_with_the_law_file_that_it_was_adopted_with_only(tmp_path: Path) -> None:
    file = LawFile.read(own_laws.law_file(tmp_path))
    written, path = adopted(tmp_path / "plants", file)
    assert (path.parent / "my_laws.py").read_text() == own_laws.COGGING
    plant, robot = AdoptedPlant.read(path)
    assert plant == written
    (term,) = plant.terms(robot, with_laws([LawFile.read(path.parent / "my_laws.py")]))
    assert isinstance(term, Term) and term.named["sine"] == 0.4
    with pytest.raises(
        ConfigError, match=r"prism3-1 has .* my_laws.py \(sha256 .*is missing: add --eff"
    ):
        plant.terms(robot, NAMED)
    other = LawFile.read(own_laws.law_file(tmp_path, own_laws.COGGING + "\n"))
    with pytest.raises(ConfigError, match="the given my_laws.py differs"):
        plant.terms(robot, with_laws([other]))
    silent = plant.model_copy(update={"effects_from": ()})
    with pytest.raises(ConfigError, match="has an effect cogging, but does not name the file"):
        silent.terms(robot, with_laws([file]))


def test_a_plant_without_law_files_is_written_as_ever(tmp_path: Path) -> None:
    gain = WrittenTerm(effect="winch_gain", parameters={"share": 0.1})
    plant = AdoptedPlant(robot=PRISM.name, digest=PRISM.digest, version=1, effects=(gain,))
    assert "effects_from" not in plant.write(tmp_path, PRISM).read_text()
