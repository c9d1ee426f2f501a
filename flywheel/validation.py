"""Validate plain values as a pydantic model, with helpful messages."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from flywheel.errors import FlywheelError
from flywheel.files import shown
from flywheel.registry import nearest

M = TypeVar("M", bound=BaseModel)
MOST_PROBLEMS = 20  # that a message tells of
LONGEST_PROBLEM = 1000  # characters, of a name or a value in it
_TYPES = {"model_type": "a mapping", "dict_type": "a mapping", "tuple_type": "a list"}
# What pydantic calls one of the types that a value may have.
_CHOICE = re.compile(r"(function-\w+|tuple|list)\[.*\]|constrained-str|str|float")


class Frozen(BaseModel):
    """Base of settings and messages: they cannot be changed, and have no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def validated(schema: type[M], values: Any, complaint: str, error: type[FlywheelError]) -> M:
    """Validate plain values, as from a YAML or JSON file.

    Args:
      schema: type of the result.
      values: plain.
      complaint: beginning of the message: "a.yaml is not a valid configuration".
      error: class to raise.

    Raises:
      error: an unknown key or a wrong value; the message lists the problems with their paths, the
        values and the allowed values.
    """
    try:
        return schema.model_validate(values)
    except ValidationError as found:
        problems = lines(_explained(schema, each) for each in found.errors())
        raise error(f"{complaint}:\n{problems}") from None


def first_problem(found: ValidationError) -> str:
    """The first of pydantic's problems, with its location and value; for files written by programs."""
    first = found.errors()[0]
    where = ".".join(map(str, first["loc"]))
    return f"{where}: {first['msg']}, got {shown(first['input'])}"


def lines(problems: Iterable[str]) -> str:
    """The first of some problems, one per line, and the number of the rest."""
    listed = list(problems)
    if (more := len(listed) - MOST_PROBLEMS) > 0:
        listed[MOST_PROBLEMS:] = [f"and {more:,} more"]
    return "\n".join(f"  {each}" for each in listed)


def _explained(schema: type[BaseModel], error: Any) -> str:
    location = error["loc"]
    told = [str(part)[:LONGEST_PROBLEM] for part in location if not _CHOICE.fullmatch(str(part))]
    where = ".".join(told) or "(the whole)"
    if error["type"] == "extra_forbidden":
        allowed = sorted(_fields_at(schema, location[:-1]))
        hint = nearest(str(location[-1]), allowed)
        return f"{where}: unknown key.{hint} Allowed: {', '.join(allowed)}."
    if error["type"] == "missing":
        return f"{where}: is required."
    said = error["msg"].removeprefix("Value error, ")[:LONGEST_PROBLEM].rstrip(".")
    if error["type"] == "value_error":  # our own words, which say what was got
        return f"{where}: {said}."
    if error["type"] in _TYPES:  # pydantic speaks of Python
        said = f"must be {_TYPES[error['type']]}"
    return f"{where}: {said}; got {shown(error['input'])}."


def _fields_at(schema: type[BaseModel], location: Sequence[str | int]) -> set[str]:
    found = {schema}
    for part in location:
        fields = [m.model_fields[str(part)].annotation for m in found if part in m.model_fields]
        found = {model for field in fields for model in _models_in(field)} or found
    return {field.alias or name for model in found for name, field in model.model_fields.items()}


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models_in(part)


def differences(old: Any, new: Any, path: str = "") -> Iterator[str]:
    """Differences between two plain configurations, as "a.b: 1 -> 2"."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(old.keys() | new.keys()):
            where = f"{path}.{key}" if path else str(key)
            yield from differences(old.get(key, "(not set)"), new.get(key, "(not set)"), where)
    elif old != new:
        before, after = (str(each)[:LONGEST_PROBLEM] or "''" for each in (old, new))
        yield f"{path}: {before} -> {after}"
