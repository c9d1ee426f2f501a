"""The table of an examination: per effect and in all, with exact intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.evaluation.intervals import Interval, success_interval
from flywheel.runtime.examination.results import CaseResult

CLOSE = 1.1  # held-out error over the noise that counts as explained


@dataclass(frozen=True)
class Line:
    """Cases of one kind.

    Attributes:
      what: the hidden effects, or a name for all of them.
      cases: how many.
      right: best answer right, or rightly said to be too small.
      first: best answer right.
      family: right but for the place.
      contained: truth among the answers.
      unseen: said to be too small, and the other simulator agrees.
      outside: said that something is missing that is none of the library's effects.
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


def summary(results: Sequence[CaseResult]) -> list[Line]:
    """One line per kind, and one for each group in all."""
    lines = []
    for group in dict.fromkeys(r.group for r in results):
        members = [r for r in results if r.group == group]
        kinds = dict.fromkeys(r.kind for r in members)
        if len(kinds) > 1:
            lines += [_line(kind, [r for r in members if r.kind == kind]) for kind in kinds]
        lines.append(_line(f"all: {group}", members))
    return lines


def _line(what: str, results: Sequence[CaseResult]) -> Line:
    def share(
        right: Callable[[CaseResult], bool], among: Sequence[CaseResult] = results
    ) -> Interval:
        return success_interval(sum(right(r) for r in among), len(among), method="exact")

    hits = [r for r in results if r.first_is_right and r.truth]
    covered = [inside for r in hits for inside in r.covered]
    verdicts = [r.verdict or "failed" for r in results]
    return Line(
        what=what,
        cases=len(results),
        right=share(lambda r: r.right),
        first=share(lambda r: r.first_is_right),
        family=share(lambda r: r.family_is_right),
        contained=share(lambda r: r.contains_truth),
        unseen=sum(r.said_unseen for r in results),
        outside=share(lambda r: r.said_outside),
        answers=float(np.mean([len(r.answers) for r in results])),
        size_error=_median([r.size_error for r in hits]),
        coverage=success_interval(sum(covered), len(covered), method="exact"),
        held_out_before=_median([r.held_out_baseline / r.noise for r in results]),
        held_out_after=_median([r.held_out / r.noise for r in results]),
        explained=share(lambda r: r.held_out / r.noise <= CLOSE, hits),
        seconds=_median([r.seconds for r in results]),
        verdicts={v: verdicts.count(v) for v in dict.fromkeys(verdicts)},
    )


def _median(values: Sequence[float]) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.median(known)) if known else float("nan")
