"""From YAML files and `key=value` arguments to a validated model, with errors one can act on."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from pydantic import BaseModel

from flywheel.errors import ConfigError
from flywheel.files import LARGEST_YAML, parsed_yaml, read_text, shown
from flywheel.runtime.config.overrides import MOST_VALUES, merged, overridden
from flywheel.runtime.config.references import check_texts, resolved
from flywheel.runtime.config.shipped import shipped_configs
from flywheel.validation import LONGEST_PROBLEM, M, validated

EXTENDS = "extends"
MOST_FILES = 50  # that one configuration is made of
MOST_NAMES = 20  # of files that are there


def read_config(schema: type[M], path: str | Path, overrides: Sequence[str] = ()) -> M:
    """Read a YAML file, put the overrides on top, and validate.

    A file may begin with `extends: other.yaml`, relative to itself, or `extends: prism3`, a configuration
    that comes with flywheel, and hold only what differs; or with a list of others, of which later ones win.
    `${a.b}` stands for the single value at that key.

    Args:
      schema: what the result must be.
      path: of the YAML file.
      overrides: "a.b=value", the value in YAML; later ones win.

    Raises:
      ConfigError: no such file, not YAML, an unknown key or a wrong value; the message lists the
        problems with their paths, what was got and what is allowed.
    """
    values = _with_parents(Path(path), {}, ())
    defaults = schema.model_construct().model_dump(mode="json")
    changed = overridden(values, overrides, defaults)
    plain = resolved(changed, f"The configuration {path}")
    return validated(schema, plain, f"{path} is not a valid configuration", ConfigError)


def yaml_of(model: BaseModel) -> str:
    """A model as the text of a file that `read_config` reads as the same model."""
    return OmegaConf.to_yaml(OmegaConf.create(model.model_dump(mode="json")))


def differences(old: Any, new: Any, path: str = "") -> Iterator[str]:
    """Where two plain configurations differ, as "a.b: 1 -> 2"."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(old.keys() | new.keys()):
            where = f"{path}.{key}" if path else str(key)
            yield from differences(old.get(key, "(not set)"), new.get(key, "(not set)"), where)
    elif old != new:
        yield f"{path}: {str(old)[:LONGEST_PROBLEM]} -> {str(new)[:LONGEST_PROBLEM]}"


def _with_parents(
    path: Path, read: dict[str, dict[Any, Any]], children: tuple[str, ...]
) -> dict[Any, Any]:
    """The values of a file, on top of those of the files that it extends.

    Args:
      path: of the file.
      read: values of the files that were read already, so that none is read twice.
      children: files that led here.
    """
    own = _identity(path)
    if own in children:
        raise ConfigError(f"{path} extends itself, by way of {children[-1]}.")
    if own in read:
        return read[own]
    if len(read) + len(children) >= MOST_FILES:
        raise ConfigError(f"{path}: a configuration is made of at most {MOST_FILES} files.")
    values = _values(path)
    below: dict[Any, Any] = {}
    for name in _names(path, values.pop(EXTENDS, [])):
        parent = shipped_configs().get(name, path.parent / name)
        below = merged(below, _with_parents(parent, read, (*children, own)))
    read[own] = merged(below, values)
    return read[own]


def _identity(path: Path) -> str:
    """The same for the same file, however it is named."""
    try:
        return os.path.realpath(path)
    except ValueError:  # a NUL in it; no such file
        return str(path)


def _values(path: Path) -> dict[Any, Any]:
    """Of one file, by itself."""
    what = f"The configuration {path}"
    try:
        text = read_text(path, "configuration", ConfigError, LARGEST_YAML)
    except ConfigError as error:
        raise ConfigError(f"{error}{_near(path)}") from None
    values = parsed_yaml(text, what, ConfigError, MOST_VALUES)
    if not isinstance(values, dict | None):
        raise ConfigError(f"{what} must hold `key: value` lines, got {shown(values)}.")
    check_texts(values, what)
    try:  # again: what YAML 1.2 calls numbers are numbers here, and no key may stand twice
        loaded = OmegaConf.to_container(OmegaConf.load(io.StringIO(text)))
    except (OmegaConfBaseException, yaml.YAMLError, ValueError) as error:
        raise ConfigError(f"{what} cannot be read: {error}") from None
    assert isinstance(loaded, dict)
    return loaded


def _names(path: Path, extended: Any) -> list[str]:
    """Of the files that one extends."""
    names = extended if isinstance(extended, list) else [extended]
    if not all(isinstance(name, str) and name for name in names):
        raise ConfigError(
            f"{path}: {EXTENDS} takes another file or a list of them, got {shown(extended)}."
        )
    return names


def _near(path: Path) -> str:
    """The configurations beside one that is not there."""
    with suppress(OSError):
        if not path.exists():
            folder = path.parent if path.parent.is_dir() else Path()
            known = sorted(p.name for p in folder.glob("*.yaml"))
            more = f" and {len(known) - MOST_NAMES} more" if len(known) > MOST_NAMES else ""
            return f" There are: {', '.join(known[:MOST_NAMES])}{more}." if known else ""
    return ""
