"""Commands whose options are declared once: as parameters, or as fields of a record of the library."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import is_dataclass
from functools import wraps
from typing import Annotated, Any, TypeVar, get_args, get_origin

import typer
from typer.models import ParameterInfo

from flywheel.cli.exits import Command
from flywheel.cli.options import within
from flywheel.options import said_of
from flywheel.quantities import Bounds

SEVERAL = (tuple, frozenset)  # kinds of parameters with several values, which are given one by one
C = TypeVar("C", bound=Callable[..., Any])


class App(typer.Typer):
    """Commands that are plain functions: positional parameters are arguments, keyword-only ones options.

    A dataclass as parameter gives an option for each of its fields. Help is in the docstrings: `Args` of
    the command, `Attributes` of the dataclass. `Annotated` adds a number's bounds, other names of an option
    ("--winch"), the value's name in the help ("MJCF"), or all of this as typer has it.
    """

    def command(self, name: str | None = None, **more: Any) -> Callable[[C], C]:
        """Make a command of a function, which stays as it is."""
        register = super().command(name, **{"cls": Command, **more})

        def registered(command: C) -> C:
            register(_declared(command))
            return command

        return registered


def _declared(command: Callable[..., None]) -> Callable[..., None]:
    """The command as typer reads it."""
    records: dict[str, tuple[Any, list[str]]] = {}
    kinds, options = {}, []
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        owner: Any = command
        found = [parameter]
        if is_dataclass(parameter.annotation):
            owner = parameter.annotation
            parts = inspect.signature(owner, eval_str=True).parameters
            found = [part.replace(kind=part.KEYWORD_ONLY) for part in parts.values()]
            records[name] = owner, list(parts)
        for each in found:
            option, kind = _as_option(each, said_of(each.name, owner))
            options.append(option)
            if kind is not None:
                kinds[each.name] = kind

    @wraps(command)
    def called(**given: Any) -> None:
        for name, kind in kinds.items():
            given[name] = kind(given[name] or ())
        for name, (record, names) in records.items():
            given[name] = record(**{each: given.pop(each) for each in names})
        command(**given)

    called.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]  # typer reads it
    called.__doc__ = (inspect.getdoc(command) or "").partition("\n\nArgs:\n")[0]
    return called


def _as_option(parameter: inspect.Parameter, said: str) -> tuple[inspect.Parameter, Any]:
    """A parameter as typer reads it; and its kind if it has several values."""
    hint, default = parameter.annotation, parameter.default
    kind, *more = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    several = get_origin(kind) if get_origin(kind) in SEVERAL else None
    if several:
        kind = list[get_args(kind)[0]]  # type: ignore[misc]
        default = default if default is parameter.empty else None
    info = next((each for each in more if isinstance(each, ParameterInfo)), None)
    if info is None:
        words = [each for each in more if isinstance(each, str)]
        how: dict[str, Any] = {
            "help": said,
            "metavar": next((word for word in words if not word.startswith("-")), None),
            "callback": next((within(each) for each in more if isinstance(each, Bounds)), None),
        }
        flags = [word for word in words if word.startswith("-")]
        option = parameter.kind is parameter.KEYWORD_ONLY
        info = typer.Option(*flags, **how) if option else typer.Argument(**how)
    made = parameter.replace(
        annotation=Annotated[kind, info], default=default, kind=parameter.KEYWORD_ONLY
    )
    return made, several
