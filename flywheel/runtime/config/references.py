"""Texts in configurations, and `${a.b}` in them: the value of another setting.

OmegaConf can do much more with `${...}`: read the environment, run functions, refer to references. None of
that is let through. What a run is made from stands in its files, and a few lines cannot become gigabytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from flywheel.errors import ConfigError
from flywheel.files import shown

MOST_REFERENCES = 100
LONGEST_WITH_REFERENCES = 500  # characters
LONGEST_TEXT = 10_000  # characters
MISSING = "???"
_BEGIN = "${"
_REFERENCE = re.compile(r"(?<!\\)\$\{([^${}:\[\]]+)\}")


def check_texts(values: Any, what: str) -> None:
    """Refuse texts that are too long, and what is no plain reference.

    Args:
      values: plain.
      what: they are, at the beginning of a sentence.

    Raises:
      ConfigError: see above; or there are too many.
    """
    texts = list(_texts(values))
    for text in texts:
        most = LONGEST_WITH_REFERENCES if _BEGIN in text else LONGEST_TEXT
        if len(text) > most:
            raise ConfigError(
                f"{what} has a text of {len(text):,} characters, {shown(text)}; at most {most:,}."
            )
        if _BEGIN in _REFERENCE.sub("", text):
            raise ConfigError(
                f"{what} has {shown(text)}. ${{a.b}} stands for the value at that key; nothing else, such "
                "as the environment, is looked up."
            )
    if sum(len(_REFERENCE.findall(text)) for text in texts) > MOST_REFERENCES:
        raise ConfigError(f"{what} has more than {MOST_REFERENCES} references (${{a.b}}).")


def resolved(values: dict[Any, Any], what: str) -> Any:
    """Values with each reference replaced by the single value that it refers to.

    Raises:
      ConfigError: a reference to nothing, to several values, or to a reference; a value that is still
        to be given ("???").
    """
    check_texts(values, what)
    for text in _texts(values):
        for key in _REFERENCE.findall(text):
            found = _at(values, key.split("."))
            if isinstance(found, dict | list) or _BEGIN in str(found):
                raise ConfigError(
                    f"{what}: ${{{key}}} refers to {shown(found)}, not to a single value."
                )
            if found is None:
                raise ConfigError(f"{what}: ${{{key}}} refers to nothing that is given there.")
    try:
        return OmegaConf.to_container(OmegaConf.create(values), resolve=True, throw_on_missing=True)
    except OmegaConfBaseException as error:
        raise ConfigError(f"{what}: {str(error).splitlines()[0]}.") from None


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
