"""Reading configurations: what is accepted, and what a wrong one is told."""

from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict, Field

from flywheel.errors import ConfigError
from flywheel.runtime.config_files import differences, read_config


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
