"""`flywheel config`: the user's own configuration, from a shipped one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.console import console

app = typer.Typer(no_args_is_help=True, help="Start a configuration of your own.")


@app.command()
def copy(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name from `flywheel list configs`.")],
    dest: Annotated[
        Path | None,
        typer.Argument(
            metavar="[DEST]", help="A file, or a folder to put it into; NAME.yaml here by default."
        ),
    ] = None,
) -> None:
    """Copy a shipped configuration, to change it. Nothing is overwritten.

    [bold]Example[/bold]

    flywheel config copy prism3 my_own.yaml
    """
    from flywheel.errors import DataError
    from flywheel.outputs import check_output, write_output
    from flywheel.runtime.config.shipped import copied_text

    text = copied_text(name)
    file = Path(f"{Path(name).name}.yaml")
    target = file if dest is None else _target(dest, file)
    check_output(target, "configuration")
    if target.exists():
        raise DataError(f"The file {target} exists already; it is not overwritten.")
    write_output(target, text)
    console().say(f"Configuration: {target}. Run it with: flywheel run {target}")


def _target(dest: Path, file: Path) -> Path:
    """The target file: itself, or one in a folder."""
    try:
        return dest / file if dest.is_dir() else dest
    except OSError:  # no name that a file can have, which is said when it is checked
        return dest
