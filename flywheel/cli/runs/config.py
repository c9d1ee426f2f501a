"""`flywheel config`: the user's own configuration, from a shipped one."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from flywheel.cli.app import App
from flywheel.cli.console import console

app = App(no_args_is_help=True, help="Start a configuration of your own.")


@app.command()
def copy(name: Annotated[str, "NAME"], dest: Annotated[Path | None, "[DEST]"] = None) -> None:
    """Copy a shipped configuration, to change it. Nothing is overwritten.

    [bold]Example[/bold]

    flywheel config copy prism3 my_own.yaml

    Args:
      name: Name from `flywheel list configs`.
      dest: A file, or a folder to put it into; NAME.yaml here by default.
    """
    from flywheel.outputs import check_new, check_output, write_output
    from flywheel.runtime.config.shipped import copied_text

    text = copied_text(name)
    file = Path(f"{Path(name).name}.yaml")
    target = file if dest is None else _target(dest, file)
    check_output(target, "configuration")
    check_new(target)
    write_output(target, text)
    console().say(f"Configuration: {target}. Run it with: flywheel run {shlex.quote(str(target))}")


def _target(dest: Path, file: Path) -> Path:
    """The target file: itself, or one in a folder."""
    try:
        return dest / file if dest.is_dir() else dest
    except OSError:  # no name that a file can have, which is said when it is checked
        return dest
