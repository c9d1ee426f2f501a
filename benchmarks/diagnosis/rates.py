"""Success rates of a diagnosis: per effect and in all, with exact intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.diagnosis.case_row import CaseRow
from flywheel.effects import EFFECTS
from flywheel.evaluation.intervals import Interval, success_interval

CLOSE = 1.1  # held-out error over the noise that counts as explained


@dataclass(frozen=True)
class Line:
    """Cases of one kind.

    Attributes:
      what: the hidden effects, or a name for all of them.
      cases: number.
      right: best answer right, or rightly called too small.
      first: best answer right.
      family: right except for the place.
      contained: truth among the answers.
      unseen: called too small, and the other simulator agrees.
      outside: the answer is that something outside the library is missing.
      answers: mean number of alternatives.
      size_error: median [-].
      coverage: of the intervals.
      held_out_before, held_out_after: median error over the noise.
      explained: share of the right answers whose held-out error is near the noise.
      seconds: median.
      verdicts: verdict -> number of cases.
    """

    what: str
    cases: int
    right: Interval
    first: Interval
    family: Interval
    contained: Interval
    unseen: int
    outside: Interval
    answers: float
    size_error: float
    coverage: Interval
    held_out_before: float
    held_out_after: float
    explained: Interval
    seconds: float
    verdicts: dict[str, int]


def summary(rows: Sequence[CaseRow]) -> list[Line]:
    """One line per kind, and one for each group in all."""
    lines = []
    for group in dict.fromkeys(r.group for r in rows):
        members = [r for r in rows if r.group == group]
        kinds = dict.fromkeys(r.kind for r in members)
        if len(kinds) > 1:
            lines += [_line(kind, [r for r in members if r.kind == kind]) for kind in kinds]
        lines.append(_line(f"all: {group}", members))
    return lines


def _line(what: str, rows: Sequence[CaseRow]) -> Line:
    def share(right: Callable[[CaseRow], bool], among: Sequence[CaseRow] = rows) -> Interval:
        return success_interval(sum(right(r) for r in among), len(among), method="exact")

    hits = [r for r in rows if r.first_is_right and r.truth]
    covered, sizes = sum(r.covered for r in hits), sum(r.sizes for r in hits)
    verdicts = [r.verdict for r in rows]
    return Line(
        what=what,
        cases=len(rows),
        right=share(lambda r: r.right),
        first=share(lambda r: r.first_is_right),
        family=share(lambda r: r.family_is_right),
        contained=share(lambda r: r.contains_truth),
        unseen=sum(r.said_unseen for r in rows),
        outside=share(lambda r: r.said_outside),
        answers=float(np.mean([r.answers for r in rows])),
        size_error=_median([r.size_error for r in hits]),
        coverage=success_interval(covered, sizes, method="exact"),
        held_out_before=_median([r.held_out_baseline for r in rows]),
        held_out_after=_median([r.held_out for r in rows]),
        explained=share(lambda r: r.held_out <= CLOSE, hits),
        seconds=_median([r.seconds for r in rows]),
        verdicts={v: verdicts.count(v) for v in dict.fromkeys(verdicts)},
    )


def _median(values: Sequence[float]) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.median(known)) if known else float("nan")


RATES_HEADER = (
    "| hidden | cases | right | first right | too small | answers | size error | in its interval "
    "| held out, before [noise] | after | s | verdicts |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
)
OUTSIDE_HEADER = (
    "| hidden | cases | said so | held out, before [noise] | after | s | verdicts |\n"
    "|---|---|---|---|---|---|---|"
)
HARD_HEADER = (
    "| robot | trouble | cases | right | too small | s, median | slowest | wrong |\n"
    "|---|---|---|---|---|---|---|---|"
)
TROUBLES = {
    "dropout": "20 % of the markers missing",
    "50hz": "50 Hz",
    "calibration": "stiffness and mass told 3 % wrong",
    "swapped": "two markers exchanged",
}
ENOUGH = 10  # cases for which an interval is shown


def rates_table(rows: Sequence[CaseRow]) -> list[str]:
    """Lines of Markdown: a row per hidden effect, and one for each group in all."""
    known = {kind: number for number, kind in enumerate(["nothing", *EFFECTS])}
    ordered = sorted(rows, key=lambda row: known.get(row.kind, len(known)))
    return [RATES_HEADER, *map(_rates, summary(ordered))]


def outside_table(rows: Sequence[CaseRow]) -> list[str]:
    """Lines of Markdown: a row per hidden effect outside the library, and one for all."""
    return [OUTSIDE_HEADER, *map(_outside, summary(rows))]


def hard_table(rows: Sequence[CaseRow]) -> list[str]:
    """Lines of Markdown: a row per robot and trouble of its hard cases."""
    lines = [HARD_HEADER]
    hard = [row for row in rows if row.group == "hard"]
    for robot, trouble in dict.fromkeys((row.robot, row.name.split(".")[2]) for row in hard):
        group = [r for r in hard if (r.robot, r.name.split(".")[2]) == (robot, trouble)]
        seconds = sorted(row.seconds for row in group)
        wrong = ", ".join(f"`{r.kind}` as {r.answer or 'nothing'}" for r in group if not r.right)
        lines.append(
            f"| {robot} | {TROUBLES[trouble]} | {len(group)} | {sum(r.right for r in group)} | "
            f"{sum(r.said_unseen for r in group)} | {np.median(seconds):.0f} | {seconds[-1]:.0f} | {wrong} |"
        )
    return lines


def _outside(line: Line) -> str:
    return (
        f"| {line.what} | {line.cases} | {_share(line.outside, line.cases)} | {line.held_out_before:.2f} | "
        f"{line.held_out_after:.2f} | {line.seconds:.0f} | {_verdicts(line)} |"
    )


def _verdicts(line: Line) -> str:
    return ", ".join(f"{name} {count}" for name, count in line.verdicts.items())


def _rates(line: Line) -> str:
    size = "-" if np.isnan(line.size_error) else f"{100 * line.size_error:.1f} %"
    return (
        f"| {line.what} | {line.cases} | {_share(line.right, line.cases)} | "
        f"{_share(line.first, line.cases)} | {line.unseen} | {line.answers:.3g} | {size} | "
        f"{_share(line.coverage, line.cases)} | {line.held_out_before:.2f} | {line.held_out_after:.2f} | "
        f"{line.seconds:.0f} | {_verdicts(line)} |"
    )


def _share(interval: Interval, cases: int) -> str:
    if np.isnan(interval.value):
        return "-"
    ends = f" ({100 * interval.low:.0f}-{100 * interval.high:.0f})" if cases >= ENOUGH else ""
    return f"{interval.value:.0%}{ends}"
