"""Files from outside: what is no file, too large or too deep is refused in a sentence."""

import math
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flywheel.errors import DataError
from flywheel.files import (
    file_name,
    opened,
    parsed_json,
    parsed_yaml,
    read_bytes,
    read_text,
    shown,
    yaml_text,
)


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("prism3", "prism3"),
        ("../ESCAPED", "ESCAPED"),
        ("/etc/passwd", "etc-passwd"),
        ("my robot (v2)", "my robot -v2"),
        ("..", "unnamed"),
        ("", "unnamed"),
        (".hidden", "hidden"),
        ("a\0b\n", "a-b"),
    ],
)
def test_a_name_becomes_one_path_component(name: str, file: str) -> None:
    assert file_name(name) == file


@given(st.text(max_size=300))
def test_no_name_leaves_its_folder(name: str) -> None:
    made = file_name(name)
    assert Path(made).name == made
    assert not made.startswith(".")
    assert len(made.encode()) <= 80
    assert file_name(made) == made


def test_what_is_no_regular_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, kind in (
        (tmp_path / "pipe", "a pipe"),
        (tmp_path, "a folder"),
        (Path("/dev/zero"), "a device"),
    ):
        with pytest.raises(DataError, match=f"The log .* is {kind}; a regular file is needed"):
            read_bytes(path, "log", DataError)


def test_what_is_not_there_or_has_an_impossible_name_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / "none", tmp_path / "file" / "below"):
        with pytest.raises(DataError, match="There is no log"):
            read_bytes(path, "log", DataError)
    for path in ("a\0b", "x" * 5000):
        with pytest.raises(DataError, match="cannot be read"):
            read_bytes(path, "log", DataError)


def test_a_file_larger_than_its_limit_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(b"x" * 101)
    with pytest.raises(DataError, match=r"has 0.000101 MB; at most 0.0001 MB"):
        read_bytes(tmp_path / "large", "log", DataError, limit=100)
    with opened(tmp_path / "large", "log", DataError, limit=None) as file:
        assert len(file.read()) == 101


def test_text_is_utf_8_with_or_without_a_mark(tmp_path: Path) -> None:
    (tmp_path / "marked").write_bytes(b"\xef\xbb\xbfa\n")
    assert read_text(tmp_path / "marked", "log", DataError) == "a\n"
    (tmp_path / "latin").write_bytes("a\nü".encode("latin-1"))
    with pytest.raises(DataError, match="line 2 has the byte 0xfc"):
        read_text(tmp_path / "latin", "log", DataError)
    (tmp_path / "zeros").write_bytes(b"a\0b")
    with pytest.raises(DataError, match="bytes of zero"):
        read_text(tmp_path / "zeros", "log", DataError)


def bomb(levels: int) -> str:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    for level in range(1, levels):
        lines.append(f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 10)}]")
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a: !!timestamp 2020-02-31", "an invalid value"),
        ("a: !!int foo", "an invalid value"),
        ("a: " + "9" * 5000, "an invalid value"),
        ("{[a]: 1}", "not YAML|an invalid value"),
        ("[" * 3000 + "]" * 3000, "brackets within brackets"),
        ("[" * 61 + "]" * 61, "more than 60 brackets within brackets"),
        (bomb(9), "more than 1,000,000 values, with aliases expanded"),
        ("a: &a [*a]", r"contains itself: \*a"),
        ("a: [", "not YAML"),
        ("a: !!python/object:os.system {}", "not YAML"),
    ],
)
def test_yaml_that_is_none_or_too_much_is_refused(text: str, why: str) -> None:
    with pytest.raises(DataError, match=f"The map x.yaml .*({why})"):
        parsed_yaml(text, "The map x.yaml", DataError)


def test_yaml_with_aliases_is_read() -> None:
    assert parsed_yaml(bomb(3), "It", DataError)["a2"][9][9] == ["x"] * 10
    assert parsed_yaml("", "It", DataError) is None
    assert parsed_yaml("[" * 60 + "]" * 60, "It", DataError)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "not JSON"),
        (b"\xff", "not JSON"),
        ("9" * 5000, "not JSON"),
        ("[" * 100_000, "brackets within brackets"),
        ("[" * 61 + "]" * 61, "brackets within brackets"),
    ],
)
def test_json_that_is_none_or_too_deep_is_refused(text: str | bytes, why: str) -> None:
    with pytest.raises(DataError, match=f"The answer .*{why}"):
        parsed_json(text, "The answer", DataError)


def test_a_value_for_a_message_is_short_however_large_it_is() -> None:
    deep: list[object] = []
    for _ in range(3000):
        deep = [deep] * 9
    assert len(shown(deep)) < 200
    assert len(shown("x" * 10**6)) < 200
    assert shown({"a": 1}) == "{'a': 1}"


def test_halves_of_characters_are_refused_because_no_file_can_hold_them() -> None:
    assert parsed_json(r'{"a": "\ud83d\ude00"}', "The answer", DataError) == {"a": "😀"}
    for text in (r'{"a": "\ud83d"}', r'{"\uDFFF": 1}'):
        with pytest.raises(DataError, match="surrogates not allowed"):
            parsed_json(text, "The answer", DataError)


def test_numbers_of_yaml_1_2_are_numbers_and_texts_come_back_as_texts() -> None:
    text = "a: 1e-3\nb: -2E5\nc: '1e3'\nd: 1.5e3\ne: 2020-02-31\n"
    values = parsed_yaml(text, "The map", DataError)
    assert values == {"a": 1e-3, "b": -2e5, "c": "1e3", "d": 1500.0, "e": "2020-02-31"}
    assert parsed_yaml(yaml_text(values), "The map", DataError) == values
    others = parsed_yaml("[010, 1:30, 0x1F, -.5, 1_000, -.inf]", "The map", DataError)
    assert others == ["010", "1:30", 31, -0.5, 1000, -math.inf]  # not 8 and 90, as in YAML 1.1


def test_a_value_that_does_not_fit_its_tag_is_refused() -> None:
    for text in (
        "!!timestamp foo",
        "!!bool foo",
        "!!int foo",
        "!!int ''",
        "!!float x",
        "!!timestamp 2020-02-31",
    ):
        with pytest.raises(DataError, match="an invalid value|does not have the type"):
            parsed_yaml(f"a: {text}", "The map", DataError)
        with pytest.raises(DataError, match="an invalid value|does not have the type"):
            parsed_yaml(f"[{text}]", "The map", DataError)


def test_a_key_that_stands_twice_is_refused() -> None:
    for text in ("a: 1\nb: 2\na: 1", "c: {a: 1, a: 2}", "[{true: 1, true: 1}]"):
        with pytest.raises(DataError, match="found duplicate key '(a|true)'"):
            parsed_yaml(text, "The map", DataError)
    assert parsed_yaml("a: {b: 1}\nc: {b: 1}", "The map", DataError)["c"] == {"b": 1}


def test_a_number_of_too_many_digits_to_be_written_is_shown() -> None:
    assert shown(10**5000) == "int of thousands of digits"
    assert len(shown([10**4000, {"a": "x" * 9999}])) < 200
