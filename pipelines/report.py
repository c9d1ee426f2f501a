"""`flywheel report`: the page of a run."""

from __future__ import annotations

from pathlib import Path

from flywheel.reports import write_page
from pipelines.show import console


def make_page(run: Path) -> None:
    """Write the page and say where it is."""
    console().say(f"Page: {write_page(run)}")
