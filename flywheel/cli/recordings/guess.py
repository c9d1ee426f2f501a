"""`flywheel recordings guess`: draft the map of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.console import console
from flywheel.outputs import check_new, write_output


def guess(
    logs: Annotated[list[Path], "LOG..."],
    *,
    robot: str,
    output: Annotated[Path | None, "--output", "-o"] = None,
) -> None:
    """Write a draft of the map of a recording, to be read and completed.

    Names are taken from the files, winches also from what the cables do.

    [bold]Example[/bold]

    flywheel recordings guess take.csv motors.txt --robot my.xml --output monday.yaml

    Args:
      logs: Files of one recording.
      robot: Your .xml, or a shipped robot's name.
      output: New file; printed if missing.
    """
    from flywheel.data.recordings import guess as guessed
    from flywheel.robots import load_robot

    if output is not None:
        check_new(output)
    text = guessed(logs, load_robot(robot), Path() if output is None else output.parent)
    if output is None:
        typer.echo(text, nl=False)
        return
    write_output(output, text)
    console().say(f"{output}: a draft; read its remarks, complete it, and import it with --map.")
