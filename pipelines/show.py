"""What the commands print: tables, numbers and lines, on one console."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table

WIDE = 140  # columns where there is no terminal, so that logs keep their tables whole


def console() -> Console:
    """The console of the results; progress and errors go to stderr instead."""
    plain = Console()
    return plain if plain.is_terminal else Console(width=WIDE)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Table:
    """A table; numbers stand in columns that end in "]" (a unit) or begin with "#"."""
    made = Table(title=title, title_justify="left", header_style="bold")
    for column in columns:
        made.add_column(
            column.removeprefix("#").replace("[", r"\["),
            justify="right" if column.endswith("]") or column.startswith("#") else "left",
        )
    for row in rows:
        made.add_row(*(cell(value) for value in row))
    return made


def cell(value: object) -> str:
    """A value as a table shows it: about four digits of a number, a dash for what there is not."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, float) and 1e4 <= abs(value) < 1e12:
        return f"{value:,.0f}"
    if isinstance(value, float):
        return f"{value:.4g}"
    return str(value).replace("[", r"\[")


def first_line(thing: object) -> str:
    """The first line of a class's or function's docstring."""
    text = (getattr(thing, "__doc__", None) or "").strip()
    return text.split("\n")[0]
