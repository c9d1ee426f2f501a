"""Commands that take frozen records: each field of a record is an option."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any


def with_records(command: Callable[..., None]) -> Callable[..., None]:
    """A command with an option for each field of those of its parameters that are dataclasses.

    The fields are declared as options are: `Annotated`, with a default.
    """
    parameters = inspect.signature(command, eval_str=True).parameters
    records: dict[str, Any] = {
        name: each.annotation for name, each in parameters.items() if is_dataclass(each.annotation)
    }

    @wraps(command)
    def called(**given: Any) -> None:
        for name, record in records.items():
            given[name] = record(**{each.name: given.pop(each.name) for each in fields(record)})
        command(**given)

    options = [
        option
        for name, parameter in parameters.items()
        for option in (_fields_of(records[name]) if name in records else [parameter])
    ]
    called.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]  # typer reads it
    return called


def _fields_of(record: Any) -> list[inspect.Parameter]:
    return list(inspect.signature(record, eval_str=True).parameters.values())
