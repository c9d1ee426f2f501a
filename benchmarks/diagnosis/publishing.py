"""Logging of an examination: its rates, after each number of cases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmarks.diagnosis.rates import Line
from flywheel.runtime.tracking.tracker import Tracker


def publish_examination(
    tracker: Tracker, lines: Sequence[Line], files: Iterable[str | Path] = ()
) -> None:
    """Log the table; the step of its numbers is the number of cases, so that rates become charts.

    Args:
      tracker: of the folder of the cases.
      lines: of the table, see `summary`.
      files: inside the folder.
    """
    tracker.open(tracker.key, tracker.key, {"flywheel.kind": "examination"})
    for line in lines:
        tracker.log(tracker.key, _values(line), line.cases)
    for file in files:
        tracker.artifact(tracker.key, file)
    tracker.end(tracker.key)


def _values(line: Line) -> dict[str, float]:
    """Numbers of a line for logging; MLflow's names know no "+"."""
    values = {
        "right": line.right.value,
        "right_low": line.right.low,
        "right_high": line.right.high,
        "first_right": line.first.value,
        "truth_among_answers": line.contained.value,
        "said_none_of_the_library": line.outside.value,
        "answers": line.answers,
        "size_error": line.size_error,
        "in_interval": line.coverage.value,
        "held_out_over_noise_before": line.held_out_before,
        "held_out_over_noise_after": line.held_out_after,
        "seconds": line.seconds,
    }
    section = line.what.replace("+", " and ")
    return {f"{section}/{name}": value for name, value in values.items() if value == value}
