"""Pages about planned experiments: effects that they would show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path

from flywheel.diagnosis.experiments.design import Design
from flywheel.diagnosis.experiments.power import Power
from flywheel.outputs import write_output
from flywheel.reports.experiment_figures import (
    likeness,
    search,
    smallest_sizes,
    told_apart,
    winch_paths,
)
from flywheel.reports.html import Shown, render
from flywheel.reports.pictures import Picture, shown

PREDICTED = (
    "All of this is predicted by the plant, for small effects around it. A robot with large "
    "missing effects leaves the predicted motion within a second.",
    "The part that unknown starts of the windows, unknown offsets of the winches and smaller "
    "time steps could explain does not count.",
)


@dataclass(frozen=True)
class Listing:
    """A table, ready for display."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def power_sentence(found: Power) -> str:
    """Effects visible under given commands, in words."""
    shown, alone = _counts(found)
    size = "their typical size" if found.size == 1 else f"{found.size:g} times their typical size"
    words = (
        f"At {size} these commands would show {shown} of {len(found.prospects)} candidates, "
        f"and distinguish {alone} of them from every other one."
    )
    if found.by_points is None:
        return words
    shown, alone = _counts(found.by_points)
    return f"{words} By points alone, without the channels, it would be {shown} and {alone}."


def _counts(found: Power) -> tuple[int, int]:
    """Visible candidates, and those of them that are distinguished from every other one."""
    shown = [prospect for prospect in found.prospects if prospect.shown]
    return len(shown), sum(not prospect.taken_for for prospect in shown)


def confusions(found: Power) -> list[str]:
    """For each visible but ambiguous candidate, the ones it may be taken for."""
    return [
        f"{p.candidate.label} may be taken for {', '.join(c.label for c in p.taken_for)}."
        for p in found.prospects
        if p.taken_for
    ]


def design_sentence(found: Design) -> str:
    """Value of a script, in words."""
    bare = "" if found.by_points is None else f" By points alone it is {found.by_points:.1f}."
    if not found.enough:
        return (
            f"No script was found that distinguishes the effects: {found.separation:.1f} sigmas, and "
            f"{found.needed:g} are needed. A longer script, less noise or another sensor may help.{bare}"
        )
    ratio = f"{found.separation / found.plain:.1f} times" if found.plain > 0 else "infinitely"
    return (
        f"These commands separate the effects by at least {found.separation:.1f} sigmas, {ratio} "
        f"as much as random steps of the same length ({found.plain:.1f}).{bare}"
    )


def write_power(found: Power, path: str | Path, about: Mapping[str, str]) -> Path:
    """Write the page of an experiment's power: one HTML file, with lines `about` it."""
    bare = found.by_points is not None
    circles = " Circles: by points alone, where that is visible." if bare else ""
    figures = [
        Picture(
            smallest_sizes,
            "Smallest visible effects",
            "Blue: the requested size would be visible. Candidates without a bar are invisible."
            + circles,
        ),
        Picture(
            likeness,
            "Candidates that resemble each other",
            "Of the candidates that show best: near one, the experiment can hardly distinguish the two.",
        ),
    ]
    return _write(
        "Power",
        power_sentence(found),
        _prospects(found),
        confusions(found),
        shown({each.title: each for each in figures}, found),
        path,
        about,
        found.enough,
    )


def _prospects(found: Power) -> Listing:
    """Each candidate with its smallest visible size, and the one that is most like it."""
    columns = (
        "effect",
        "smallest visible",
        "in typical sizes",
        *(() if found.by_points is None else ("by points alone",)),
        "most like",
        "|cos|",
        "apart [sigma]",
    )
    rows, by_points = [], found.bare_sizes
    for p in found.prospects:
        unit, rival = p.candidate.effect.sizes[0].unit, p.rival
        seen = (f"{p.smallest * p.candidate.typical[0]:.3g} {unit}", f"{p.smallest:.3g}")
        pair = ("", "", "") if rival is None else (
            rival.label, f"{p.likeness:.3f}", f"{p.separation:.1f}"
        )  # fmt: skip
        alone = by_points.get(p.candidate.label)
        bare = [] if alone is None else ["invisible" if isnan(alone) else f"{alone:.3g}"]
        rows.append((p.candidate.label, *(seen if p.visible else ("invisible", "")), *bare, *pair))
    return Listing(columns, rows)


def write_design(
    found: Design, path: str | Path, about: Mapping[str, str], winches: Sequence[str]
) -> Path:
    """Write the page of a design: one HTML file, with lines `about` it.

    Args:
      found: to show.
      path: of the file.
      about: its provenance, as lines of two columns.
      winches: their names.
    """
    figures = [
        Picture(
            told_apart,
            "Separation",
            (
                "The change caused by one effect at its typical size that the other cannot explain "
                "at any size."
            ),
        ),
        Picture(
            lambda found: winch_paths(found, winches),
            "Positions of the winches",
            f"Rest lengths under the commands. The script started as one of {found.family!r}.",
        ),
        Picture(search, "The search", "Scripts are drawn, and the best varied."),
    ]
    columns = ("effects", "", "|cos|", "apart [sigma]", "random: |cos|", "random: apart [sigma]")
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
        shown({each.title: each for each in figures}, found),
        path,
        about,
        found.needed,
    )


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
    counts = (
        f"{enough:g} sigmas count as visible, and as distinguished: a score of {enough**2:g} in a "
        "diagnosis."
    )
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
