"""Output of the commands: tables, numbers and lines, on one console.

Text from outside is never interpreted: not as markup of Rich ("[red]"), as an emoji (":x:") or as a
control code of the terminal.
"""

from __future__ import annotations

import errno
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from flywheel.outputs import printable, write_output

WIDE = 140  # columns where there is no terminal, so that logs keep their tables whole


class Out(Console):
    """The console of the results; progress and errors go to stderr instead."""

    def __init__(self, width: int | None = None) -> None:
        super().__init__(width=width, emoji=False)

    def say(self, text: str, style: str | None = None) -> None:
        """Print a line unchanged, of any length."""
        self.print(printable(text), style=style, markup=False, soft_wrap=True)

    def keep_json(
        self, path: Path | None, summary: Mapping[str, object], allow_nan: bool = True
    ) -> None:
        """Write a command's answer as JSON, if requested, and print its path."""
        if path is not None:
            write_output(path, json.dumps(summary, indent=1, allow_nan=allow_nan) + "\n")
            self.say(f"JSON: {path}")

    def on_broken_pipe(self) -> None:
        """The reader has closed the output: `flywheel.cli.exits` ends the command."""
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))


def console() -> Out:
    """The console of the results: as wide as the terminal."""
    plain = Out()
    return plain if plain.is_terminal else Out(WIDE)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Table:
    """A table; columns whose names end in "]" (a unit) or begin with "#" contain numbers."""
    heading = Text(printable(title), style="table.title")
    made = Table(title=heading, title_justify="left", header_style="bold")
    for column in columns:
        made.add_column(
            Text(printable(column.removeprefix("#"))),
            justify="right" if column.endswith("]") or column.startswith("#") else "left",
        )
    for row in rows:
        made.add_row(*(Text(printable(cell(value))) for value in row))
    return made


def cell(value: object) -> str:
    """A value in the format of a table: about four digits of a number, a dash for a missing value."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float) and 1e4 <= abs(value) < 1e12:
        return f"{value:,.0f}"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value)


def first_line(thing: object) -> str:
    """The first line of a class's or function's docstring."""
    text = (getattr(thing, "__doc__", None) or "").strip()
    return text.split("\n")[0]
