"""`--picture`: a robot with the names of its parts, as `check` and `adapt` write it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.console import Out

if TYPE_CHECKING:
    from flywheel.robots import Robot

PictureOption = Annotated[
    Path | None,
    typer.Option(help="Output file (.png) of a picture with the names of bodies, cables, points."),
]


def write_picture(out: Out, robot: Robot, path: Path) -> None:
    """Write a picture of a robot at its keyframe.

    Raises:
      DataError: it cannot be written.
    """
    from flywheel.dynamics.plant.portrait import portrait
    from flywheel.outputs import write_output
    from flywheel.reports.pictures import as_file
    from flywheel.reports.portrait_figure import portrait_figure

    content = as_file(lambda: portrait_figure(*portrait(robot)), "png")
    assert content is not None
    write_output(path, content)
    out.say(f"{path}: the robot at its keyframe, with the names of its parts.")
