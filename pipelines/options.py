"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer

WindowOption = Annotated[
    float | None,
    typer.Option(
        help="Length of the windows, in seconds; suits the robot by default.", show_default=False
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[KEY=VALUE]...",
        help="Settings to change, by their path in the configuration, e.g. mppi.samples=64.",
        show_default=False,
    ),
]
