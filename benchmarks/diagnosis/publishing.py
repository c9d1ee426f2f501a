"""Logging of an examination: its rates, after each number of cases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmarks.diagnosis.rates import Line
from flywheel.runtime.tracking.mlflow_client import Board


def publish_examination(
    board: Board, key: str, lines: Sequence[Line], files: Iterable[str | Path] = ()
) -> None:
    """Log the table; the step of its numbers is the number of cases, so that rates become charts.

    Args:
      board: of the folder of the cases.
      key: of the examination.
      lines: of the table, see `summary`.
      files: inside the folder.
    """
    run = board.run(key, key, {"flywheel.kind": "examination"})
    board.log(run, [(line.cases, _values(line)) for line in lines])
    for file in files:
        board.artifact(run, file)
    board.status(run, "FINISHED")


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
