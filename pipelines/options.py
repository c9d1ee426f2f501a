"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer


def _control_step(dt: float) -> float:
    from flywheel.records import check_control_step

    check_control_step(dt)
    return dt


WindowOption = Annotated[
    float | None,
    typer.Option(
        help="Length of the windows, in seconds; suits the robot by default.", show_default=False
    ),
]
DtOption = Annotated[
    float,
    typer.Option(callback=_control_step, help="Control step, in seconds (0.0001 to 10)."),
]
Overrides = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[KEY=VALUE]...",
        help="Settings to change, by their path in the configuration, e.g. mppi.samples=64.",
        show_default=False,
    ),
]
