"""`key=value` arguments on top of plain values: `mppi.samples=64`, `datasets.0.name=soft`."""

from __future__ import annotations

import copy
import re
from collections.abc import Sequence
from typing import Any

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from flywheel.errors import ConfigError
from flywheel.files import parsed_yaml, shown
from flywheel.runtime.config.references import check_texts

MOST_OVERRIDES = 1000  # of a command; a configuration has fewer settings
MOST_VALUES = 10_000  # of a file or an override, as many as OmegaConf reads
_KEY = re.compile(r"[^.\[\]]+(\.[^.\[\]]+){0,20}")


def merged(old: Any, new: Any) -> Any:
    """Mappings are merged, anything else is replaced."""
    if isinstance(old, dict) and isinstance(new, dict):
        return {**old, **{key: merged(old.get(key), value) for key, value in new.items()}}
    return new


def overridden(
    values: dict[Any, Any], overrides: Sequence[str], defaults: dict[str, Any]
) -> dict[Any, Any]:
    """Values with overrides put on top, later ones over earlier ones.

    Args:
      values: as from a file.
      overrides: "a.b=value", the value in YAML; "a.0.b" or "a[0].b" is within the first entry of a list.
      defaults: of what is not in the values; their lists are taken where an entry of one is changed.

    Raises:
      ConfigError: not of that form, not YAML, or a list does not have that entry.
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
    """The parts of the key, and the value."""
    key, equals, text = override.partition("=")
    plain = re.sub(r"\[(\w+)\]", r".\1", key)
    if not equals or not _KEY.fullmatch(plain):
        raise ConfigError(
            "An override is key=value, e.g. training.initial.steps=500 or datasets.0.name=soft; got "
            f"{shown(override)}."
        )
    what = f"The value of {shown(override)}"
    check_texts(parsed_yaml(text, what, ConfigError, MOST_VALUES), what)
    try:
        parsed = OmegaConf.from_dotlist([f"value={text}"])
    except (OmegaConfBaseException, yaml.YAMLError, ValueError) as error:
        raise ConfigError(f"{what} cannot be read: {error}") from None
    values = OmegaConf.to_container(parsed)
    assert isinstance(values, dict)
    return plain.split("."), values["value"]


def _changed(here: Any, key: list[str], value: Any, default: Any, override: str) -> Any:
    """A copy of `here` in which the value stands at the key."""
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
    """Index of an entry."""
    number = int(part) if re.fullmatch(r"[0-9]{1,6}", part) else len(entries)
    if number >= len(entries):
        there = f"0 to {len(entries) - 1}" if entries else "none"
        raise ConfigError(
            f"{shown(override)}: the list has no entry {shown(part)}; there are {len(entries)} ({there}). "
            "To add one, give the whole list."
        )
    return number
