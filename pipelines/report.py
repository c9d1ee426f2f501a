"""`flywheel report`: the page of a run."""

from __future__ import annotations

from pathlib import Path


def make_page(run: Path) -> None:
    """Write the page and say where it is."""
