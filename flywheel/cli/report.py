"""`flywheel report`: the page of a run."""

from __future__ import annotations

from pathlib import Path

from flywheel.cli.show import console
from flywheel.reports import write_page


def make_page(run: Path) -> None:
    """Write the page and say where it is."""
    console().say(f"Page: {write_page(run)}")
