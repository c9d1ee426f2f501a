"""Reads a configuration: YAML files, `key=value` overrides and `${a.b}` references become a validated model.

References to the environment, to references or to several values are rejected, so a run depends only
on the content of its files, and a few lines cannot become gigabytes.
"""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from flywheel.errors import ConfigError
from flywheel.files import parsed_yaml, read_yaml, shown, yaml_text
from flywheel.runtime.config.shipped import shipped_configs
from flywheel.validation import M, validated

EXTENDS = "extends"
MOST_FILES = 50  # that one configuration may be made of
MOST_NAMES = 20  # of existing files that an error lists


def read_config(
    schema: type[M],
    path: str | Path,
    overrides: Sequence[str] = (),
    beside: Iterable[str] = (),
    only_beside: bool = False,
    over: Iterable[Path] = (),
) -> M:
    """Read a YAML file, apply the overrides, and validate.

    A file may begin with `extends: other.yaml`, relative to itself, or `extends: prism3`, a shipped
    configuration, and contain only the differences; or with a list of others, of which later ones
    win. `${a.b}` stands for the single value at that key.

    Args:
      schema: type of the result.
      path: of the YAML file.
      overrides: "a.b=value", the value in YAML; later ones win.
      beside: keys whose values are files, or lists of files, named relative to the file that they stand in.
      only_beside: refuse such a file that is in another folder.
      over: further files, whose values win over those of the first.

    Raises:
      ConfigError: no such file, not YAML, an unknown key or a wrong value; the message lists the
        problems with their paths, the values and the allowed values.
    """
    files = Beside(tuple(beside), only_beside)
    values: dict[Any, Any] = {}
    for file in (Path(path), *over):
        values = merged(values, _with_parents(file, {}, (), files))
    defaults = schema.model_construct().model_dump(mode="json")
    changed = overridden(values, overrides, defaults)
    plain = resolved(changed, f"The configuration {path}")
    return validated(schema, plain, f"{path} is not a valid configuration", ConfigError)


def yaml_of(model: BaseModel) -> str:
    """The YAML text that `read_config` reads as the same model."""
    return yaml_text(model.model_dump(mode="json"))


@dataclass(frozen=True)
class Beside:
    """Files that a configuration names relative to itself.

    Attributes:
      keys: their keys, at the top of the file.
      only: they must be in the folder of the configuration itself.
    """

    keys: tuple[str, ...]
    only: bool

    def placed(self, values: dict[Any, Any], path: Path) -> dict[Any, Any]:
        """The values of a file with the paths of such files.

        Raises:
          ConfigError: one is in another folder and must not be.
        """
        found = {key: self._placed(values[key], path) for key in self.keys if key in values}
        return {**values, **found}

    def _placed(self, value: Any, path: Path) -> Any:
        if isinstance(value, list):
            return [self._placed(each, path) for each in value]
        if isinstance(value, dict) and "file" in value:  # as it is written down, with its digest
            return {**value, "file": self._placed(value["file"], path)}
        if not isinstance(value, str):
            return value
        if self.only and Path(value).name != value:
            raise ConfigError(f"{path} may only name files in its own folder, got {shown(value)}.")
        return str(path.parent / value)


def _with_parents(
    path: Path, read: dict[str, dict[Any, Any]], children: tuple[str, ...], beside: Beside
) -> dict[Any, Any]:
    """The values of a file, merged into those of the files that it extends.

    Args:
      path: of the file.
      read: cached values of files.
      children: the chain of files that extend this one.
      beside: keys whose values are files.
    """
    own = _identity(path)
    if own in children:
        raise ConfigError(f"{path} extends itself, by way of {children[-1]}.")
    if own in read:
        return read[own]
    if len(read) + len(children) >= MOST_FILES:
        raise ConfigError(f"{path}: a configuration consists of at most {MOST_FILES} files.")
    values = beside.placed(_values(path), path)
    below: dict[Any, Any] = {}
    for name in _names(path, values.pop(EXTENDS, [])):
        parent = shipped_configs().get(name, path.parent / name)
        below = merged(below, _with_parents(parent, read, (*children, own), beside))
    read[own] = merged(below, values)
    return read[own]


def _identity(path: Path) -> str:
    """A key that is the same for the same file, however its path is written."""
    try:
        return os.path.realpath(path)
    except ValueError:  # a NUL in it; no such file
        return str(path)


def _values(path: Path) -> dict[Any, Any]:
    """The values of one file alone."""
    try:
        values = read_yaml(path, "configuration", ConfigError, MOST_VALUES)
    except ConfigError as error:
        raise ConfigError(f"{error}{_near(path)}") from None
    if not isinstance(values, dict | None):
        raise ConfigError(
            f"The configuration {path} must hold `key: value` lines, got {shown(values)}."
        )
    return values or {}


def _names(path: Path, extended: Any) -> list[str]:
    """The names of the files that a file extends."""
    names = extended if isinstance(extended, list) else [extended]
    if not all(isinstance(name, str) and name for name in names):
        raise ConfigError(
            f"{path}: {EXTENDS} takes another file or a list of them, got {shown(extended)}."
        )
    return names


def _near(path: Path) -> str:
    """A sentence with the configurations next to a missing one; "" if it is not missing."""
    with suppress(OSError):
        if not path.exists():
            folder = path.parent if path.parent.is_dir() else Path()
            known = sorted(p.name for p in folder.glob("*.yaml"))
            more = f" and {len(known) - MOST_NAMES} more" if len(known) > MOST_NAMES else ""
            return f" There are: {', '.join(known[:MOST_NAMES])}{more}." if known else ""
    return ""


MOST_OVERRIDES = 1000  # of a command; a configuration has fewer settings
MOST_VALUES = 10_000  # of a file or an override, as many as OmegaConf reads
_KEY = re.compile(r"[^.\[\]]+(\.[^.\[\]]+){0,20}")


def merged(old: Any, new: Any) -> Any:
    """The new value merged into the old one: mappings are merged, anything else is replaced."""
    if isinstance(old, dict) and isinstance(new, dict):
        return {**old, **{key: merged(old.get(key), value) for key, value in new.items()}}
    return new


def overridden(
    values: dict[Any, Any], overrides: Sequence[str], defaults: dict[str, Any]
) -> dict[Any, Any]:
    """The values with the overrides applied; later overrides win.

    Args:
      values: of a file.
      overrides: "a.b=value", the value in YAML; "a.0.b" or "a[0].b" is in the first entry of a
        list.
      defaults: used if an override changes an entry of a list that is missing in the values.

    Raises:
      ConfigError: an override is not of this form or not YAML, or a list has no such entry.
    """
    if len(overrides) > MOST_OVERRIDES:
        raise ConfigError(
            f"There are {len(overrides):,} overrides; at most {MOST_OVERRIDES:,} are read. Put them into "
            "a file."
        )
    for override in overrides:
        key, value = _parsed(override)
        values = _changed(values, key, value, defaults, override)
    return values


def _parsed(override: str) -> tuple[list[str], Any]:
    """The parts of the key of an override, and its value."""
    key, equals, text = override.partition("=")
    plain = re.sub(r"\[(\w+)\]", r".\1", key)
    if not equals or not _KEY.fullmatch(plain):
        raise ConfigError(
            "An override is key=value, e.g. training.initial.steps=500 or datasets.0.name=soft; got "
            f"{shown(override)}."
        )
    what = f"The value of {shown(override)}"
    return plain.split("."), parsed_yaml(text, what, ConfigError, MOST_VALUES)


def _changed(here: Any, key: list[str], value: Any, default: Any, override: str) -> Any:
    """A copy of `here` with the value at the key."""
    if not key:
        return merged(here, value)
    part, rest = key[0], key[1:]
    if here is None and isinstance(default, list):
        here = copy.deepcopy(default)
    if isinstance(here, list):
        number = _place(part, here, override)
        inner = _changed(here[number], rest, value, None, override)
        return [*here[:number], inner, *here[number + 1 :]]
    here = here if isinstance(here, dict) else {}
    default = default.get(part) if isinstance(default, dict) else None
    return {**here, part: _changed(here.get(part), rest, value, default, override)}


def _place(part: str, entries: list[Any], override: str) -> int:
    """The index of an entry of a list."""
    number = int(part) if re.fullmatch(r"[0-9]{1,6}", part) else len(entries)
    if number >= len(entries):
        there = f"0 to {len(entries) - 1}" if entries else "none"
        raise ConfigError(
            f"{shown(override)}: the list has no entry {shown(part)}; there are {len(entries)} ({there}). "
            "To add one, give the whole list."
        )
    return number


LONGEST_TEXT = 10_000  # characters
_BEGIN = "${"
_REFERENCE = re.compile(r"(?<!\\)\$\{([^${}:\[\]]+)\}")


def resolved(values: dict[Any, Any], what: str) -> Any:
    """The values with each reference replaced by its single value.

    Args:
      values: plain values: mappings, lists, texts, numbers.
      what: their name, at the beginning of a sentence.

    Raises:
      ConfigError: a `${...}` that is not the key of a single value, or a text that is too long.
    """
    for text in _texts(values):
        _check_text(text, what)

    def single(key: str) -> Any:
        found = _at(values, key.split("."))
        if isinstance(found, dict | list) or _BEGIN in str(found):
            raise ConfigError(
                f"{what}: ${{{key}}} refers to {shown(found)}, not to a single value."
            )
        if found is None:
            raise ConfigError(f"{what}: ${{{key}}} refers to a missing value.")
        return found

    def filled(here: Any) -> Any:
        if isinstance(here, dict):
            return {key: filled(value) for key, value in here.items()}
        if isinstance(here, list):
            return [filled(value) for value in here]
        if not isinstance(here, str):
            return here
        if whole := _REFERENCE.fullmatch(here):
            return single(whole[1])
        text = _REFERENCE.sub(lambda match: str(single(match[1])), here)
        _check_length(text, what)
        return text

    return filled(values)


def _check_text(text: str, what: str) -> None:
    _check_length(text, what)
    if _BEGIN in _REFERENCE.sub("", text):
        raise ConfigError(
            f"{what} has {shown(text)}. ${{a.b}} stands for the value at that key; nothing else, such "
            "as the environment, is looked up."
        )


def _check_length(text: str, what: str) -> None:
    if len(text) > LONGEST_TEXT:
        raise ConfigError(
            f"{what} has a text of {len(text):,} characters, {shown(text)}; at most {LONGEST_TEXT:,}."
        )


def _texts(values: Any) -> Iterator[str]:
    if isinstance(values, str):
        yield values
    elif isinstance(values, dict):
        for key, value in values.items():
            yield from _texts(key)
            yield from _texts(value)
    elif isinstance(values, list):
        for value in values:
            yield from _texts(value)


def _at(values: Any, key: list[str]) -> Any:
    """The value at a key, or None."""
    for part in key:
        if isinstance(values, list) and re.fullmatch(r"[0-9]{1,6}", part):
            values = dict(enumerate(values)).get(int(part))
        else:
            values = values.get(part) if isinstance(values, dict) else None
    return values
