"""Files from users: read only if they are regular files of a sensible size.

The caller gives a name for the message, and the error class for a bad file. Nothing here waits for
a pipe, follows a device, or reads more than its limit.
"""

from __future__ import annotations

import json
import os
import re
import reprlib
import stat
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import yaml

from flywheel.errors import FlywheelError

MB = 1e6
LARGEST_TEXT = 20 * MB  # of an MJCF or a JSON file [bytes]; the largest of ours has 1 MB
LARGEST_YAML = 2 * MB  # [bytes]
DEEPEST = 60  # brackets within brackets: far more than any file of ours has
MOST_VALUES = 1_000_000  # single values of a file, aliases written out
LONGEST_PATH = 1000  # characters of one that is told whole
LONGEST_NAME = 80  # characters of a file's name that is made of another name
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother = 2, 60, 60
_SHORT.maxlist = _SHORT.maxdict = _SHORT.maxtuple = 4
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


class _Loader(yaml.CSafeLoader):
    """Reads numbers as YAML 1.2 does, and a date as a text; refuses a key that stands twice.

    So `1e-3` is a number, and neither `010` (of base 8 in YAML 1.1) nor `1:30` (of base 60) is one.
    """

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise yaml.constructor.ConstructorError(
                None, None, f"found duplicate key {shown(twice)}", node.start_mark
            )
        return super().construct_mapping(node, deep)


class _Dumper(yaml.CSafeDumper):
    """Writes the text "1e-3" in quotes."""


_DIGITS, _EXPONENT = "[0-9][0-9_]*", r"[eE][-+]?[0-9]+"
_NUMBERS = {
    "int": r"[-+]?(0|[1-9][0-9_]*|0x[0-9a-fA-F]+)$",
    "float": rf"[-+]?({_DIGITS}\.[0-9_]*({_EXPONENT})?|\.{_DIGITS}({_EXPONENT})?|{_DIGITS}{_EXPONENT}"
    r"|\.(inf|Inf|INF))$|\.(nan|NaN|NAN)$",
}
_ELSEWHERE = tuple(f"tag:yaml.org,2002:{kind}" for kind in (*_NUMBERS, "timestamp"))
_Loader.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in forms if tag not in _ELSEWHERE]
    for first, forms in _Loader.yaml_implicit_resolvers.items()
}
for _each in (_Loader, _Dumper):
    for _kind, _form in _NUMBERS.items():
        _each.add_implicit_resolver(
            f"tag:yaml.org,2002:{_kind}", re.compile(_form), list("-+.0123456789")
        )


def file_name(name: str) -> str:
    """A name as the name of a file or folder: one path component, never hidden.

    The only way from a name in a file, such as a robot's, to a path. Everything that is not a
    letter, a digit, ".", "_", "-", "+" or a space becomes "-".
    """
    plain = unicodedata.normalize("NFKC", name)
    safe = re.sub(r"[^\w.+ -]+", "-", plain).strip("-. ")
    while len(safe.encode()) > LONGEST_NAME:
        safe = safe[:-1]
    return safe.rstrip("-. ") or "unnamed"


@contextmanager
def opened(
    path: str | Path, what: str, error: type[FlywheelError], limit: float | None = LARGEST_TEXT
) -> Iterator[BinaryIO]:
    """Open a regular file for reading.

    Args:
      path: of the file.
      what: its kind, for messages: "recording", "MJCF".
      error: class to raise.
      limit: of its size [bytes]; None for any.

    Raises:
      error: it does not exist; it is a folder, a pipe or a device; it is too large; it is not
        readable.
    """
    path = Path(path)
    try:
        # Without O_NONBLOCK opening a pipe waits for a writer, for ever.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        raise error(f"There is no {what} {path}.") from None
    except (OSError, ValueError) as problem:  # ValueError: a NUL in the path
        name = str(path)
        name = repr(name) if len(name) < LONGEST_PATH else shown(name)
        raise error(f"The {what} {name} cannot be read: {_reason(problem)}.") from None
    about = os.fstat(handle)
    if not stat.S_ISREG(about.st_mode):
        os.close(handle)
        kind = _KINDS.get(stat.S_IFMT(about.st_mode), "no regular file")
        raise error(f"The {what} {path} is {kind}; a regular file is needed.")
    with os.fdopen(handle, "rb") as file:
        if limit is not None and about.st_size > limit:
            raise error(
                f"The {what} {path} has {about.st_size / MB:.4g} MB; at most {limit / MB:g} MB are read."
            )
        yield file


def read_bytes(
    path: str | Path, what: str, error: type[FlywheelError], limit: float = LARGEST_TEXT
) -> bytes:
    """Contents of a regular file; see `opened`."""
    with opened(path, what, error, limit) as file:
        try:
            content = file.read(int(limit) + 1)
        except OSError as problem:
            raise error(f"The {what} {path} cannot be read: {_reason(problem)}.") from None
    if len(content) > limit:  # files of /proc say that they are empty
        raise error(f"The {what} {path} has more than {limit / MB:g} MB, the most that is read.")
    return content


def read_text(
    path: str | Path, what: str, error: type[FlywheelError], limit: float = LARGEST_TEXT
) -> str:
    """Text of a regular file in UTF-8, with or without a byte order mark.

    Raises:
      error: see `opened`; or it is not UTF-8.
    """
    content = read_bytes(path, what, error, limit)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = content[: problem.start].count(b"\n") + 1
        raise error(
            f"The {what} {path} is not text in UTF-8: line {line} has the byte "
            f"0x{content[problem.start]:02x}. Save it as UTF-8."
        ) from None
    if "\0" in text:
        raise error(f"The {what} {path} is not text: it contains bytes of zero.")
    return text


def read_yaml(
    path: str | Path, what: str, error: type[FlywheelError], most: int = MOST_VALUES
) -> Any:
    """Plain values of a YAML file; None of an empty one.

    Raises:
      error: see `read_text`; or it is not YAML, or deeper or larger (with aliases expanded) than
        allowed.
    """
    text = read_text(path, what, error, LARGEST_YAML)
    return parsed_yaml(text, f"The {what} {path}", error, most)


def parsed_yaml(text: str, what: str, error: type[FlywheelError], most: int = MOST_VALUES) -> Any:
    """Plain values of a text in YAML; see `read_yaml`.

    Args:
      text: in YAML.
      what: its name, at the beginning of a sentence: "The map a.yaml".
      error: class to raise.
      most: largest number of single values, with aliases expanded.
    """
    try:
        _check_yaml(text, what, error, most)
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as problem:
        raise error(f"{what} is not YAML: {problem}") from None
    except (ValueError, TypeError) as problem:  # 2020-02-31, !!int foo, a list as a key
        reason = str(problem).partition(";")[0]  # Python adds which of its own limits to raise
        raise error(f"{what} has an invalid value: {reason}.") from None
    except (AttributeError, LookupError):  # !!timestamp foo, !!bool foo
        raise error(f"{what} has a value that does not have the type in front of it.") from None
    except RecursionError:
        raise error(f"{what} has more than {DEEPEST} brackets within brackets.") from None


def yaml_text(values: Any) -> str:
    """Plain values as a text for `parsed_yaml`."""
    return yaml.dump(values, Dumper=_Dumper, sort_keys=False, width=100, allow_unicode=True)


def _check_yaml(text: str, what: str, error: type[FlywheelError], most: int) -> None:
    """Reject texts that would be too large when expanded, by their events alone."""
    sizes, anchors = [0], [""]  # of each collection that is open: values so far, and its anchor
    known: dict[str, int] = {}  # anchor -> values
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        size, anchor = 1, getattr(event, "anchor", None) or ""
        if isinstance(event, yaml.CollectionStartEvent):
            sizes.append(0)
            anchors.append(anchor)
            if len(sizes) > DEEPEST + 1:
                raise error(f"{what} has more than {DEEPEST} brackets within brackets.")
            continue
        if isinstance(event, yaml.CollectionEndEvent):
            size, anchor = 1 + sizes.pop(), anchors.pop()
        elif isinstance(event, yaml.AliasEvent):
            if anchor in anchors:
                raise error(f"{what} contains itself: *{anchor} is within &{anchor}.")
            size = known.get(anchor, 1)
        known[anchor] = size
        sizes[-1] += size
        if sizes[-1] > most:
            raise error(f"{what} has more than {most:,} values, with aliases expanded.")


def read_json(path: str | Path, what: str, error: type[FlywheelError]) -> Any:
    """Plain values of a JSON file.

    Raises:
      error: see `read_text`; or it is not JSON, or too deep.
    """
    return parsed_json(read_text(path, what, error), f"The {what} {path}", error)


def parsed_json(text: str | bytes, what: str, error: type[FlywheelError]) -> Any:
    """Plain values of a text in JSON; see `parsed_yaml`."""
    try:
        values = json.loads(text)
        if "\\ud" in str(text).lower():  # halves of characters, which no file can hold
            json.dumps(values, ensure_ascii=False).encode()
    except RecursionError:
        raise error(f"{what} has more than {DEEPEST} brackets within brackets.") from None
    except ValueError as problem:  # also of 5000 digits, and of bytes that are no text
        raise error(f"{what} is not JSON: {problem}.") from None
    if _deeper_than(values, DEEPEST):
        raise error(f"{what} has more than {DEEPEST} brackets within brackets.")
    return values


def _deeper_than(values: Any, most: int) -> bool:
    """True if lists and mappings are nested deeper than the limit."""
    level = [values]
    for _ in range(most):
        level = [
            inner
            for each in level
            if isinstance(each, dict | list)
            for inner in (each.values() if isinstance(each, dict) else each)
        ]
    return any(isinstance(each, dict | list) for each in level)


def is_plain(text: str) -> bool:
    """True if a text can be shown to people: no control characters, and all of it was UTF-8."""
    return all(unicodedata.category(c) not in ("Cc", "Cs") or c in "\t\r\n" for c in text)


def shown(value: object) -> str:
    """A value for a message: the beginning of its repr, for any size or depth."""
    try:
        return _SHORT.repr(value)
    except ValueError:  # a whole number of more digits than Python writes
        return f"{type(value).__name__} of thousands of digits"


def _reason(problem: Exception) -> str:
    return (isinstance(problem, OSError) and problem.strerror) or str(problem)
