"""Commands that take frozen records: each field of a record is an option."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer
from typer.models import ParameterInfo

from flywheel.cli.options import within
from flywheel.options import said_of
from flywheel.quantities import Bounds

SEVERAL = (tuple, frozenset)  # fields with several values, which are given one by one


def with_records(command: Callable[..., None]) -> Callable[..., None]:
    """A command with an option for each field of those of its parameters that are dataclasses.

    Fields are declared as options are (`Annotated`, with a default), or are plain ones of a record of the
    library: their help is in its docstring, and `Annotated` gives their bounds, or another name.
    """
    parameters = inspect.signature(command, eval_str=True).parameters
    records: dict[str, Any] = {
        name: each.annotation for name, each in parameters.items() if is_dataclass(each.annotation)
    }

    @wraps(command)
    def called(**given: Any) -> None:
        for name, record in records.items():
            values = {each.name: given.pop(each.name) for each in fields(record)}
            for field, kind in _kinds(record).items():
                values[field] = kind(values[field] or ())
            given[name] = record(**values)
        command(**given)

    options = [
        option
        for name, parameter in parameters.items()
        for option in (_fields_of(records[name]) if name in records else [parameter])
    ]
    called.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]  # typer reads it
    return called


def _kinds(record: Any) -> dict[str, Any]:
    """Type of each field with several values."""
    hints = get_type_hints(record)
    return {name: get_origin(hint) for name, hint in hints.items() if get_origin(hint) in SEVERAL}


def _fields_of(record: Any) -> list[inspect.Parameter]:
    hints = get_type_hints(record, include_extras=True)
    return [
        parameter.replace(**_as_option(record, name, hints[name], parameter.default))
        for name, parameter in inspect.signature(record).parameters.items()
    ]


def _as_option(record: Any, name: str, hint: Any, default: Any) -> dict[str, Any]:
    """Annotation and default of a field as an option."""
    kind, *more = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    if any(isinstance(each, ParameterInfo) for each in more):
        return {"annotation": hint, "default": default}
    if get_origin(kind) in SEVERAL:
        kind, default = list[get_args(kind)[0]] | None, None  # type: ignore[misc]
    bounds = next((within(each) for each in more if isinstance(each, Bounds)), None)
    flags = [each for each in more if isinstance(each, str)]
    option = typer.Option(*flags, help=said_of(name, record), callback=bounds)
    return {"annotation": Annotated[kind, option], "default": default}
