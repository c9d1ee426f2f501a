"""Pages about experiments that are still to be made: what they would show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flywheel.diagnosis.experiments.design import Design
from flywheel.diagnosis.experiments.power import Power
from flywheel.outputs import write_output
from flywheel.reports.experiment_figures import (
    likeness,
    search,
    smallest_sizes,
    svg,
    told_apart,
    winch_paths,
)
from flywheel.reports.html import Shown, data_uri, render

PREDICTED = (
    "All of this is predicted by the plant, for small effects around it. A robot that lacks much is "
    "elsewhere after a second than the plant says.",
    "What unknown starts of the windows, unknown offsets of the winches and smaller time steps could "
    "explain does not count.",
)


@dataclass(frozen=True)
class Listing:
    """A table, ready to be shown."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def power_sentence(found: Power) -> str:
    """What commands would show, in words."""
    shown = [prospect for prospect in found.prospects if prospect.shown]
    alone = [prospect for prospect in shown if not prospect.taken_for]
    size = "their typical size" if found.size == 1 else f"{found.size:g} times their typical size"
    return (
        f"At {size} these commands would show {len(shown)} of {len(found.prospects)} candidates, and "
        f"tell {len(alone)} of them from every other one."
    )


def confusions(found: Power) -> list[str]:
    """For each candidate that would be seen, but not for sure as itself, what it may be taken for."""
    return [
        f"{p.candidate.label} may be taken for {', '.join(c.label for c in p.taken_for)}."
        for p in found.prospects
        if p.taken_for
    ]


def design_sentence(found: Design) -> str:
    """What a script is worth, in words."""
    if not found.enough:
        return (
            f"No script was found that tells the rivals apart: {found.separation:.1f} sigmas, and "
            f"{found.needed:g} are needed. A longer script, less noise or another sensor may do it."
        )
    ratio = f"{found.separation / found.plain:.1f} times" if found.plain > 0 else "infinitely"
    return (
        f"These commands tell the rivals at least {found.separation:.1f} sigmas apart, {ratio} as far as "
        f"random steps of the same length ({found.plain:.1f})."
    )


def write_power(found: Power, path: str | Path, about: Mapping[str, str]) -> Path:
    """Write the page of an experiment's power: one HTML file, with lines `about` it."""
    figures = [
        _shown(
            svg(lambda: smallest_sizes(found)),
            "How small an effect would show",
            "Blue: the size asked about would be seen. Candidates without a bar are invisible.",
        ),
        _shown(
            svg(lambda: likeness(found)),
            "Who would be taken for whom",
            "Of the candidates that show best: near one, the experiment can hardly tell two apart.",
        ),
    ]
    columns = ("effect", "smallest seen", "in typical sizes", "most like", "|cos|", "apart [sigma]")
    rows = []
    for p in found.prospects:
        unit, rival = p.candidate.effect.sizes[0].unit, p.rival
        seen = (f"{p.smallest * p.candidate.typical[0]:.3g} {unit}", f"{p.smallest:.2f}")
        pair = ("", "", "") if rival is None else (
            rival.label, f"{p.likeness:.3f}", f"{p.separation:.1f}"
        )  # fmt: skip
        rows.append((p.candidate.label, *(seen if p.visible else ("invisible", "")), *pair))
    notes = confusions(found)
    return _write(
        "Power",
        power_sentence(found),
        Listing(columns, rows),
        notes,
        figures,
        path,
        about,
        found.enough,
    )


def write_design(
    found: Design, path: str | Path, about: Mapping[str, str], winches: Sequence[str]
) -> Path:
    """Write the page of a design: one HTML file, with lines `about` it.

    Args:
      found: to show.
      path: of the file.
      about: where it comes from, as lines of two columns.
      winches: their names.
    """
    figures = [
        _shown(
            svg(lambda: told_apart(found)),
            "How far apart",
            "What one rival at its typical size changes and the other, at any size, cannot explain.",
        ),
        _shown(
            svg(lambda: winch_paths(found, winches)),
            "Where the winches go",
            f"Rest lengths under the commands. The script began as one of {found.family!r}.",
        ),
        _shown(svg(lambda: search(found)), "The search", "Scripts are drawn, and the best varied."),
    ]
    columns = ("rivals", "", "|cos|", "apart [sigma]", "random: |cos|", "random: apart [sigma]")
    rows = [
        (
            pair.first.label,
            pair.second.label,
            f"{pair.likeness:.3f}",
            f"{pair.separation:.1f}",
            f"{pair.plain_likeness:.3f}",
            f"{pair.plain:.1f}",
        )
        for pair in found.pairs
    ]
    notes = [f"{found.tried} scripts were tried; {found.unsafe} diverged or went slack."]
    return _write(
        "Design",
        design_sentence(found),
        Listing(columns, rows),
        notes,
        figures,
        path,
        about,
        found.needed,
    )


def _shown(content: bytes, title: str, caption: str) -> Shown:
    return Shown(title, title, caption, data_uri(content, "image/svg+xml"))


def _write(
    title: str,
    sentence: str,
    listing: Listing,
    notes: Sequence[str],
    figures: Sequence[Shown],
    path: str | Path,
    about: Mapping[str, str],
    enough: float,
) -> Path:
    counts = f"{enough:g} sigmas count as seen, and as told apart: a score of {enough**2:g} in a diagnosis."
    page = render(
        "experiment",
        title=title,
        sentence=sentence,
        listing=listing,
        notes=notes,
        figures=figures,
        about=about,
        limits=(PREDICTED[0], counts, *PREDICTED[1:]),
    )
    return write_output(path, page)
