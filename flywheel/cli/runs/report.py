"""`flywheel report`: the page of a run."""

from __future__ import annotations

from flywheel.cli.console import console
from flywheel.cli.options import RunArgument


def report(run: RunArgument) -> None:
    """Make the page of a run, finished or not: one self-contained HTML file.

    [bold]Example[/bold]

    flywheel report runs/prism3
    """
    from flywheel.reports import write_page

    console().say(f"Page: {write_page(run)}")
