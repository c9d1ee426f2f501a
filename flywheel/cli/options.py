"""Options that several commands have."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, TypeVar

import typer

from flywheel.quantities import CONTROL_STEP, HORIZON_SECONDS, THREADS, Bounds

N = TypeVar("N", int, float, None)
TYPICAL_SIZES = Bounds(0.01, 1000)  # of an effect


def within(bounds: Bounds) -> Callable[[N], N]:
    """A callback that lets numbers within the bounds pass, and an option that is not given."""

    def checked(value: N) -> N:
        if value is not None and value not in bounds:
            raise typer.BadParameter(f"It must be a number {bounds}; got {value!r}.")
        return value

    return checked


def number(text: str, what: str, bounds: Bounds) -> float:
    """A number within bounds, of a text.

    Args:
      text: to be read.
      what: it is, at the beginning of a sentence.
      bounds: that it must be in.

    Raises:
      ConfigError: it is none.
    """
    from flywheel.errors import ConfigError
    from flywheel.files import shown

    try:
        value = float(text)
    except ValueError:
        value = math.nan  # which is within no bounds
    if value not in bounds:
        raise ConfigError(f"{what} must be a number {bounds}; got {shown(text)}.")
    return value


WindowOption = Annotated[
    float | None,
    typer.Option(
        help="Length of the windows, in seconds; suits the robot by default.",
        show_default=False,
        callback=within(HORIZON_SECONDS),
    ),
]
ThreadsOption = Annotated[
    int, typer.Option(help="Simulations at the same time.", callback=within(THREADS))
]
DtOption = Annotated[
    float, typer.Option(help="Control step, in seconds.", callback=within(CONTROL_STEP))
]
Overrides = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[KEY=VALUE]...",
        help="Settings to change, by their path in the configuration, e.g. mppi.samples=64.",
        show_default=False,
    ),
]
