"""Reading configurations: what is accepted, and what a wrong one is told."""

import os
import re
from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict, Field

from flywheel.errors import ConfigError
from flywheel.runtime.config.loading import read_config
from flywheel.validation import differences


class Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    steps: int = Field(default=100, gt=0)
    rate: float = 1e-3


class Whole(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    name: str = "a"
    training: Part = Part()
    finetune: Part | None = None
    plants: tuple[Part, ...] = ()


@pytest.fixture
def write(tmp_path):
    def written(name: str, text: str) -> Path:
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return written


def test_overrides_win_over_the_file_and_the_file_over_the_defaults(write):
    path = write("a.yaml", "name: b\ntraining: {steps: 5}\n")
    config = read_config(Whole, path, ["training.rate=3e-4", "name=c"])
    assert config == Whole(name="c", training=Part(steps=5, rate=3e-4))


def test_a_file_that_extends_another_holds_only_what_differs(write):
    write("base.yaml", "name: base\ntraining: {steps: 5, rate: 0.1}\n")
    path = write("more.yaml", "extends: base.yaml\ntraining: {steps: 7}\n")
    assert read_config(Whole, path) == Whole(name="base", training=Part(steps=7, rate=0.1))


def test_of_several_files_that_one_extends_later_ones_win(write):
    write("one.yaml", "name: one\ntraining: {steps: 5, rate: 0.1}\n")
    write("two.yaml", "training: {steps: 6}\n")
    path = write("more.yaml", "extends: [one.yaml, two.yaml]\nname: more\n")
    assert read_config(Whole, path) == Whole(name="more", training=Part(steps=6, rate=0.1))


@pytest.mark.parametrize("extended", ["3", "[a.yaml, 3]", "''", "{a: b}", "null"])
def test_what_names_no_file_to_extend_is_refused(write, extended):
    with pytest.raises(ConfigError, match="another file or a list of them, got"):
        read_config(Whole, write("a.yaml", f"extends: {extended}\n"))


def test_a_file_that_extends_itself_is_refused(write):
    with pytest.raises(ConfigError, match="extends itself"):
        read_config(Whole, write("own.yaml", "extends: [own.yaml]\n"))
    write("a.yaml", "extends: b.yaml\n")
    with pytest.raises(ConfigError, match="extends itself"):
        read_config(Whole, write("b.yaml", "extends: a.yaml\n"))


def test_an_unknown_key_is_told_its_path_the_nearest_name_and_all_allowed_ones(write):
    with pytest.raises(ConfigError) as caught:
        read_config(Whole, write("a.yaml", "training: {step: 5}\n"))
    message = str(caught.value)
    assert "training.step: unknown key. Did you mean 'steps'? Allowed: rate, steps." in message
    assert "a.yaml" in message


def test_unknown_keys_inside_lists_and_optional_parts_are_told_their_own_names(write):
    path = write("a.yaml", "plants: [{rat: 1}]\nfinetune: {stps: 5}\n")
    with pytest.raises(ConfigError) as caught:
        read_config(Whole, path)
    assert "plants.0.rat: unknown key. Did you mean 'rate'?" in str(caught.value)
    assert "finetune.stps: unknown key. Did you mean 'steps'?" in str(caught.value)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("training.steps=abc", "training.steps: .*valid integer.*got 'abc'"),
        ("training.steps=-3", "training.steps: .*greater than 0; got -3"),
        ("training=3", "training: .*got 3"),
        ("name=[1,2]", "name: .*got \\[1, 2\\]"),
        ("training.steps", "key=value"),
        ("=3", "key=value"),
    ],
)
def test_wrong_values_are_refused_with_what_was_got(write, override, said):
    with pytest.raises(ConfigError, match=said):
        read_config(Whole, write("a.yaml", "name: b\n"), [override])


def test_all_problems_are_told_at_once(write):
    with pytest.raises(ConfigError) as caught:
        read_config(Whole, write("a.yaml", "nam: b\ntraining: {steps: x, rat: 1}\n"))
    assert len(str(caught.value).splitlines()) == 4


def test_a_missing_file_names_those_that_are_there(write):
    there = write("prism3.yaml", "name: b\n")
    with pytest.raises(ConfigError, match="There are: prism3.yaml"):
        read_config(Whole, there.with_name("prsm3.yaml"))


@pytest.mark.parametrize("text", ["a: [", "- 1\n- 2\n", "name: ${nowhere}\n"])
def test_files_that_are_no_configuration_are_refused(write, text):
    with pytest.raises(ConfigError):
        read_config(Whole, write("a.yaml", text))


def test_differences_name_the_path_and_both_values():
    old = {"a": {"b": 1, "c": [1]}, "gone": 2}
    new = {"a": {"b": 1, "c": [1, 2]}, "new": 3}
    assert list(differences(old, new)) == [
        "a.c: [1] -> [1, 2]",
        "gone: 2 -> (not set)",
        "new: (not set) -> 3",
    ]


def test_a_file_that_is_extended_often_is_read_once_and_as_often_as_there_are_files(write):
    for number in range(40):
        write(f"d{number}.yaml", f"extends: [d{number + 1}.yaml, d{number + 1}.yaml]\n")
    write("d40.yaml", "name: the last\n")
    assert read_config(Whole, write("d.yaml", "extends: d0.yaml\n")).name == "the last"


def test_a_chain_of_more_files_than_a_configuration_is_made_of_is_refused(write):
    for number in range(60):
        write(f"c{number}.yaml", f"extends: c{number + 1}.yaml\n")
    write("wide.yaml", f"extends: [{', '.join(f'w{n}.yaml' for n in range(60))}]\n")
    for number in range(60):
        write(f"w{number}.yaml", "name: a\n")
    for name in ("c0.yaml", "wide.yaml"):
        with pytest.raises(ConfigError, match="consists of at most 50 files"):
            read_config(Whole, write("a.yaml", f"extends: {name}\n"))


def test_what_is_no_file_that_can_be_extended_is_told(write, tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    for name in ("pipe.yaml", "loop.yaml", ".", "/dev/zero", '"a\\0b"', "x" * 5000):
        with pytest.raises(ConfigError) as caught:
            read_config(Whole, write("a.yaml", f"extends: {name}\n"))
        assert re.search("is a (pipe|folder|device)|cannot be read", str(caught.value))
        assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: !!timestamp 2020-02-31", "an invalid value: day is out of range"),
        ("name: !!int foo", "an invalid value"),
        ("name: !!timestamp foo", "does not have the type in front of it"),
        ("name: !!bool foo", "does not have the type in front of it"),
        (f"name: {'1' * 5000}", "an invalid value"),
        (f"name: 0x{'f' * 6000}", "valid string; got int of thousands of digits"),
        (f"name: {'[' * 100}{']' * 100}", "more than 60 brackets"),
        (f"name: [{'a, ' * 20_000}]", "more than 10,000 values"),
        (f"name: {'x' * 20_000}", "a text of 20,000 characters, 'xxx.*at most 10,000"),
        (f"? {'x' * 20_000}\n: 1", "a text of 20,000 characters"),
        ("name: a\nname: b", "duplicate key 'name'"),
        ("1: 2\ntrue: 3\nnull: 4", "cannot be read|Keys should be strings"),
        ("{a: {b: {c: &d [1]}}, name: *d}", "name: .*valid string; got \\[1\\]"),
    ],
)  # fmt: skip
def test_values_that_no_configuration_has_are_refused_in_a_sentence(write, text, said):
    with pytest.raises(ConfigError, match=said) as caught:
        read_config(Whole, write("a.yaml", f"{text}\n"))
    assert len(str(caught.value)) < 1000


def test_of_many_problems_the_first_are_told_and_the_others_counted(write):
    keys = "\n".join(f"key{number}: 1" for number in range(250))
    with pytest.raises(ConfigError, match="\n  and 230 more$") as caught:
        read_config(Whole, write("a.yaml", keys))
    assert len(str(caught.value).splitlines()) == 22


def test_a_reference_stands_for_the_single_value_at_a_key(write):
    path = write("a.yaml", "name: run-${training.steps}\ntraining: {steps: 5}\n")
    assert read_config(Whole, path).name == "run-5"
    assert read_config(Whole, path, ["training.steps=7"]).name == "run-7"
    path = write("b.yaml", "plants: [{steps: 3}]\ntraining: {steps: '${plants.0.steps}'}\n")
    assert read_config(Whole, path).training.steps == 3


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: ${name}", "not to a single value"),
        (
            "name: ${training}\ntraining: {steps: 5}",
            "refers to {'steps': 5}, not to a single value",
        ),
        ("name: ${nowhere.at.all}", "refers to a missing value"),
        ("name: ${oc.env:HOME}", "nothing else, such as the environment"),
        ("name: '${oc.create:{a: 1}}'", "nothing else"),
        ("name: ${..name}", "refers to a missing value"),
        ("name: 'a${'", "nothing else"),
        ("name: '\\${a}'", "nothing else"),
        ("name: ${training.${name}}", "nothing else"),
        ("a0: x\n" + "".join(f"a{n + 1}: ${{a{n}}}${{a{n}}}\n" for n in range(40)), "single value"),
        (f"name: {'${a}' * 200}\na: {'x' * 90}", "a text of 18,000 characters.*at most 10,000"),
    ],
)
def test_nothing_else_is_looked_up(write, text, said):
    with pytest.raises(ConfigError, match=said):
        read_config(Whole, write("a.yaml", f"{text}\n"))


PLANTS = "plants: [{steps: 1}, {steps: 2}]\n"


@pytest.mark.parametrize(
    "override", ["plants.1.steps=7", "plants[1].steps=7", "plants.1={steps: 7}"]
)
def test_an_override_can_change_an_entry_of_a_list(write, override):
    config = read_config(Whole, write("a.yaml", PLANTS), [override])
    assert [plant.steps for plant in config.plants] == [1, 7]


def test_an_override_can_change_an_entry_of_a_list_that_is_a_default(write):
    class Outer(BaseModel):
        inner: Whole = Whole(plants=(Part(steps=3), Part(steps=4)))

    path = write("a.yaml", "inner: {name: b}\n")
    config = read_config(Outer, path, ["inner.plants.0.steps=9"]).inner
    assert (config.name, [plant.steps for plant in config.plants]) == ("b", [9, 4])


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("plants.2.steps=7", r"no entry '2'; there are 2 \(0 to 1\)"),
        ("plants.-1.steps=7", "no entry '-1'"),
        ("plants.steps=7", "no entry 'steps'"),
        (f"plants.{'9' * 5000}.steps=7", "no entry '999"),
        ("training.steps.0=7", "training.steps: .*got {'0': 7}"),
        ("a..b=1", "key=value"),
        (".a=1", "key=value"),
        ("a.=1", "key=value"),
        ("a]=1", "key=value"),
        (f"{'a.' * 5000}b=1", "key=value"),
        ("name=[", "is not YAML"),
        ("name={", "is not YAML"),
        ("name=", "name: .*valid string; got None"),
        ("name=!!timestamp 2020-02-31", "an invalid value"),
        ("name=${oc.env:HOME}", "nothing else"),
        ("extends=b.yaml", "extends: unknown key"),
        (f"name=[{'a, ' * 20_000}]", "more than 10,000 values"),
        (f"name={'x' * 1_000_000}", "a text of 1,000,000 characters"),
        (f"{'x' * 1_000_000}=1", "a text of 1,000,000 characters"),
    ],
)  # fmt: skip
def test_an_override_that_cannot_be_is_told_why(write, override, said):
    with pytest.raises(ConfigError, match=said) as caught:
        read_config(Whole, write("a.yaml", PLANTS), [override])
    assert len(str(caught.value)) < 1000


def test_more_overrides_than_there_are_settings_are_refused(write):
    with pytest.raises(ConfigError, match="100,000 overrides; at most 1,000"):
        read_config(Whole, write("a.yaml", PLANTS), ["name=b"] * 100_000)


def test_a_mapping_as_an_override_changes_what_it_names(write):
    path = write("a.yaml", "training: {steps: 5, rate: 0.5}\n")
    assert read_config(Whole, path, ["training={steps: 6}"]).training == Part(steps=6, rate=0.5)


def test_a_date_is_a_text_as_it_is_written(write):
    path = write("a.yaml", "name: 2026-11-29\n")
    assert read_config(Whole, path).name == "2026-11-29"
    assert read_config(Whole, path, ["name=2020-02-31"]).name == "2020-02-31"
